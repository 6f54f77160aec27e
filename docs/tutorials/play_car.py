# SPDX-License-Identifier: Apache-2.0
"""A car on a CAN adapter: sends its battery, and shows the heater's power. Other end: the file `adapter`."""

from contextlib import suppress
import os
import signal
import time
import tty

import cantools

# Ctrl-C ends it without a traceback.
signal.signal(signal.SIGINT, signal.SIG_DFL)
DBC = cantools.database.load_file('my_car.dbc')
STATE, REQUEST = DBC.get_message_by_name('BMS_State'), DBC.get_message_by_name('HEATER_Request')
mine, theirs = os.openpty()
tty.setraw(theirs)
os.set_blocking(mine, False)
if os.path.lexists('adapter'):
    os.remove('adapter')
os.symlink(os.ttyname(theirs), 'adapter')
temperature_c, power_w, shown_w, count, text = -7.0, 0.0, None, 0, b''
heard_s = time.monotonic()
while True:
    time.sleep(0.1)
    count = (count + 1) % 16
    current_a = -(12e3 + power_w) / 400.0
    data = STATE.encode({'BMS_Temperature': temperature_c, 'BMS_Charge': 80.0, 'BMS_Voltage': 400.0,
                         'BMS_Current': current_a, 'BMS_Counter': count})
    # The text protocol of slcan adapters: t, identifier, length, data.
    with suppress(BlockingIOError):
        os.write(mine, f't{STATE.frame_id:03X}8{data.hex().upper()}\r'.encode())
        text += os.read(mine, 4096)
    *lines, text = text.split(b'\r')
    for line in lines:
        if line.startswith(f't{REQUEST.frame_id:03X}'.encode()):
            power_w = REQUEST.decode(bytes.fromhex(line[5:].decode()))['HEATER_Power']
            heard_s = time.monotonic()
    if time.monotonic() - heard_s > 0.5:
        # A heater without commands is off.
        power_w = 0.0
    temperature_c += 0.1 * 0.87 * power_w / 377e3
    if power_w != shown_w:
        print(f'heater: {power_w:g} W, battery: {temperature_c:.1f} degC', flush=True)
        shown_w = power_w
