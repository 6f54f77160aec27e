# SPDX-License-Identifier: Apache-2.0
"""
Run plans of a Cortex-M7 build in an emulator: count instructions, and measure the stack with a filled stack.

Instruction counts are neither cycles nor a time.
"""

from __future__ import annotations

import struct
from typing import Any, TYPE_CHECKING

from bev_preheat_studies.footprint.situations import Planned

if TYPE_CHECKING:
    from pathlib import Path

    from bev_preheat_studies.footprint.builds import Build
    from bev_preheat_studies.footprint.situations import FootprintCase

PAGE = 0x1000
STACK_AT, STACK_BYTES, PAINT = 0x6000_0000, 1 << 18, b'\xa5'
NUMBERS_AT, NUMBERS_BYTES = 0x7000_0000, 1 << 18
ANSWER_AT, ANSWER = NUMBERS_AT + NUMBERS_BYTES - PAGE, struct.Struct('<10d')
# The return address at which the emulator stops.
END = 0x7800_0000
CODE_AT = 0x0001_0000
FUNCTIONS = ('take_situation', 'plan_switch', 'plan_by_values', 'tell_plan')
# Enable access to the floating-point unit, and the unit itself.
CPACR, FULL_ACCESS, FPEXC_ENABLED = (15, 0, 0, 1, 0, 0, 2), 0xF << 20, 1 << 30
# The first five bits of a halfword that starts a 32-bit instruction.
LONG_INSTRUCTIONS = (0b11101, 0b11110, 0b11111)


class EmulatedCortexM7:
    """
    A program loaded into the emulator.

    Its CPU model has all instructions, in Thumb state, because the emulator's own Cortex-M7 has no double
    precision.
    """

    def __init__(self, build: Build) -> None:
        """Link the program and load it."""
        import unicorn
        from unicorn import arm_const

        self._arm: Any = arm_const
        self._emulator: Any = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB)
        self._emulator.ctl_set_cpu_model(arm_const.UC_CPU_ARM_MAX)
        self._load(build.link('planned.elf', '-nostartfiles', '-specs=nosys.specs', '-Wl,-e,plan_switch',
                              f'-Wl,-Ttext-segment={CODE_AT:#x}',
                              *(f'-Wl,-u,{name}' for name in FUNCTIONS)))
        for at, size in ((STACK_AT, STACK_BYTES), (NUMBERS_AT, NUMBERS_BYTES), (END, PAGE)):
            self._emulator.mem_map(at, size)
        self._emulator.reg_write(arm_const.UC_ARM_REG_CP_REG, (*CPACR, FULL_ACCESS))
        self._emulator.reg_write(arm_const.UC_ARM_REG_FPEXC, FPEXC_ENABLED)
        self._instructions = 0
        # Instructions of each executed block, by its address and size.
        self._counts: dict[tuple[int, int], int] = {}
        self._emulator.hook_add(unicorn.UC_HOOK_BLOCK, self._on_block)

    def plan(self, method: int, situation: FootprintCase) -> Planned:
        """Return the result and cost of a plan by METHODS[method] in a FootprintCase."""
        self._emulator.mem_write(NUMBERS_AT, situation.numbers.tobytes())
        self._call('take_situation', situation.steps, NUMBERS_AT)
        self._emulator.mem_write(STACK_AT, PAINT * STACK_BYTES)
        self._instructions = 0
        status = self._call('plan_by_values' if method else 'plan_switch')
        instructions = self._instructions
        stack = bytes(self._emulator.mem_read(STACK_AT, STACK_BYTES))
        self._call('tell_plan', ANSWER_AT)
        told = ANSWER.unpack(self._emulator.mem_read(ANSWER_AT, ANSWER.size))
        return Planned(status, len(stack.lstrip(PAINT)), instructions, told)

    def _load(self, program: Path) -> None:
        from elftools.elf.elffile import ELFFile

        with program.open('rb') as file:
            elf = ELFFile(file)
            segments = [(each['p_vaddr'], each['p_memsz'], each.data()) for each in elf.iter_segments('PT_LOAD')]
            symbols: Any = elf.get_section_by_name('.symtab')
            self._addresses = {name: symbols.get_symbol_by_name(name)[0]['st_value'] for name in FUNCTIONS}
        first = min(at for at, _, _ in segments) // PAGE * PAGE
        end = -(-max(at + size for at, size, _ in segments) // PAGE) * PAGE
        self._emulator.mem_map(first, end - first)
        for at, _, data in segments:
            self._emulator.mem_write(at, data)

    def _call(self, name: str, *arguments: int) -> int:
        emulator, arm = self._emulator, self._arm
        for register, value in zip((arm.UC_ARM_REG_R0, arm.UC_ARM_REG_R1), arguments):
            emulator.reg_write(register, value)
        emulator.reg_write(arm.UC_ARM_REG_SP, STACK_AT + STACK_BYTES)
        # The last bit selects Thumb state.
        emulator.reg_write(arm.UC_ARM_REG_LR, END | 1)
        emulator.emu_start(self._addresses[name] | 1, END)
        status: int = struct.unpack('<i', struct.pack('<I', emulator.reg_read(arm.UC_ARM_REG_R0)))[0]
        return status

    def _on_block(self, emulator: Any, at: int, size: int, _: object) -> None:
        count = self._counts.get((at, size))
        if count is None:
            count = self._counts[at, size] = instructions_in(bytes(emulator.mem_read(at, size)))
        self._instructions += count


def instructions_in(code: bytes) -> int:
    """Return the number of Thumb instructions in bytes, each one or two halfwords (ARMv7-M, A5.1)."""
    halfwords = [each for each, in struct.iter_unpack('<H', code)]
    count = at = 0
    while at < len(halfwords):
        at += 2 if halfwords[at] >> 11 in LONG_INSTRUCTIONS else 1
        count += 1
    return count
