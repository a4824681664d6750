"""Property that is computed once per instance, without a lock.

`functools.cached_property` of Python 3.11 holds one lock per property, not per instance, so that
threads that simulate different records wait for each other. Python 3.12 has no lock.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, Self, TypeVar, overload

Value = TypeVar('Value')


class cached_property(Generic[Value]):
    """Compute a property at the first access and store it in the instance.

    Two threads that access a new property of one instance may both compute it; both get equal
    values.
    """

    def __init__(self, function: Callable[[Any], Value]) -> None:
        self._function = function
        self._name = function.__name__
        self.__doc__ = function.__doc__

    @overload
    def __get__(self, instance: None, owner: type) -> Self: ...

    @overload
    def __get__(self, instance: object, owner: type) -> Value: ...

    def __get__(self, instance: object | None, owner: type) -> Self | Value:
        """Return the stored value; an instance attribute of the same name replaces this later."""
        if instance is None:
            return self
        value = self._function(instance)
        vars(instance)[self._name] = value
        return value
