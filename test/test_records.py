# SPDX-License-Identifier: Apache-2.0
"""Frozen dataclasses that are made at once, against those that the standard library makes."""

from dataclasses import dataclass, field, FrozenInstanceError, replace
import inspect
import pickle
from typing import ClassVar

import pytest

from bev_preheat.records import kept_property, made_at_once


@dataclass(frozen=True)
class Usual:
    source: ClassVar[str] = 'somewhere'
    first_s: float
    second_w: float
    name: str = 'none'
    kept: dict = field(default_factory=dict, init=False, repr=False, compare=False)


@made_at_once
@dataclass(frozen=True)
class AtOnce:
    source: ClassVar[str] = 'somewhere'
    first_s: float
    second_w: float
    name: str = 'none'
    kept: dict = field(default_factory=dict, init=False, repr=False, compare=False)

    @kept_property
    def sum_of_both(self):
        """Both."""
        self.kept['asked'] = self.kept.get('asked', 0) + 1
        return self.first_s + self.second_w


@pytest.mark.parametrize('arguments, named', [
    ((1.5, 2.5), {}), ((1.5, 2.5, 'some'), {}), ((1.5,), {'second_w': 2.5}),
    ((), {'name': 'other', 'second_w': 7.0, 'first_s': 3.0})])
def test_it_is_what_the_usual_constructor_makes(arguments, named):
    usual, made = Usual(*arguments, **named), AtOnce(*arguments, **named)
    assert vars(made) == vars(usual)
    assert repr(made).removeprefix('AtOnce') == repr(usual).removeprefix('Usual')
    assert made == AtOnce(*arguments, **named) and hash(made) == hash(usual)
    assert made != replace(made, first_s=-1.0)
    assert replace(made, name='third') == AtOnce(made.first_s, made.second_w, 'third')
    assert pickle.loads(pickle.dumps(made)) == made


def test_arguments_are_those_of_the_usual_constructor():
    usual, made = (inspect.signature(cls.__init__).parameters for cls in (Usual, AtOnce))
    assert [*made] == [*usual]
    assert [each.default for each in made.values()] == [each.default for each in usual.values()]
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'second_w'"):
        AtOnce(1.0)
    with pytest.raises(TypeError, match="unexpected keyword argument 'kept'"):
        AtOnce(1.0, 2.0, kept={})


def test_each_has_its_own_of_what_is_made():
    assert AtOnce(1.0, 2.0).kept is not AtOnce(1.0, 2.0).kept


def test_nothing_can_be_set():
    made = AtOnce(1.0, 2.0)
    with pytest.raises(FrozenInstanceError):
        made.first_s = 3.0
    with pytest.raises(FrozenInstanceError):
        del made.name


def test_what_more_a_class_does_is_refused():
    with pytest.raises(TypeError, match='Checked has a __post_init__'):
        @made_at_once
        @dataclass(frozen=True)
        class Checked:
            def __post_init__(self):
                pass
    with pytest.raises(TypeError, match='^values: '):
        @made_at_once
        @dataclass(frozen=True)
        class Listing:
            values: list = field(default_factory=list)
    with pytest.raises(TypeError, match='^value: '):
        @made_at_once
        @dataclass(frozen=True, kw_only=True)
        class ByName:
            value: float = 1.0


def test_a_kept_property_is_worked_out_once():
    made, other = AtOnce(1.0, 2.0), AtOnce(10.0, 2.0)
    assert [made.sum_of_both, made.sum_of_both, other.sum_of_both] == [3.0, 3.0, 12.0]
    assert made.kept == {'asked': 1}
    assert AtOnce.sum_of_both.__doc__ == 'Both.'
