# SPDX-License-Identifier: Apache-2.0
"""Frozen dataclasses that are cheap to make and to ask: each update of the planner makes some thirty."""

from __future__ import annotations

from dataclasses import Field, fields, MISSING
from typing import Any, Generic, overload, Self, TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

Class = TypeVar('Class')
Value = TypeVar('Value')


def made_at_once(cls: type[Class]) -> type[Class]:
    """
    Return a frozen dataclass whose constructor writes all fields at once.

    That of `dataclass` calls `object.__setattr__` for each field, which takes three times as long. Everything
    else stays: the arguments, their defaults, and that nothing can be set afterwards. Raises TypeError for a
    class that does more when it is made.
    """
    if hasattr(cls, '__post_init__'):
        raise TypeError(f'{cls.__name__} has a __post_init__, which would not be called')
    parameters, values = ['self'], []
    given: dict[str, Any] = {}
    for field in fields(cls):  # type: ignore[arg-type]
        if field.init:
            parameters.append(_parameter(field, given))
            values.append(f'{field.name!r}: {field.name}')
        else:
            given[f'make_{field.name}'] = field.default_factory
            values.append(f'{field.name!r}: make_{field.name}()')
    exec(f'def __init__({", ".join(parameters)}):\n self.__dict__.update({{{", ".join(values)}}})', given)
    constructor = given['__init__']
    constructor.__qualname__ = f'{cls.__qualname__}.__init__'
    constructor.__annotations__ = cls.__init__.__annotations__
    cls.__init__ = constructor  # type: ignore[method-assign]
    return cls


def _parameter(field: Field[Any], given: dict[str, Any]) -> str:
    """Return a field as a parameter; its default is put into `given`."""
    if field.default_factory is not MISSING or field.kw_only:
        raise TypeError(f'{field.name}: a default that is made, or a keyword, is not provided for')
    if field.default is MISSING:
        return field.name
    given[f'default_{field.name}'] = field.default
    return f'{field.name}=default_{field.name}'


class kept_property(Generic[Value]):  # noqa: N801  a decorator, named as that of functools
    """
    A property that is worked out when it is asked for the first time, and then kept in its object.

    As `functools.cached_property`, which before Python 3.12 takes a lock for it.
    """

    def __init__(self, work_out: Callable[[Any], Value]) -> None:
        """Take the method that works it out."""
        self._work_out, self.__doc__ = work_out, work_out.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        """Take the name under which it is kept."""
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...

    @overload
    def __get__(self, instance: object, owner: type) -> Value: ...

    def __get__(self, instance: object | None, owner: type) -> Self | Value:
        """Return the value; what is kept goes before this."""
        if instance is None:
            return self
        value = vars(instance)[self._name] = self._work_out(instance)
        return value
