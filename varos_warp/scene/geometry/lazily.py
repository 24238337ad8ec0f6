"""Values that objects make when they are first asked for, though threads ask at once."""

from collections.abc import Callable
from threading import RLock
from typing import Any, Generic, TypeVar, overload

T = TypeVar("T")


class once(Generic[T]):  # noqa: N801 (a decorator, as `property` is)
    """A property that one thread makes of an object, while others that ask for it wait.

    `functools.cached_property` has one lock for all objects in Python 3.11, so that no two of them are made at a time,
    and none from 3.12 on, so that several threads make the same.
    """

    def __init__(self, make: Callable[[Any], T]):
        self._make, self.__doc__ = make, make.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> "once[T]": ...

    @overload
    def __get__(self, instance: object, owner: type) -> T: ...

    def __get__(self, instance, owner):
        if instance is None:
            return self
        known = instance.__dict__  # which hides this where there is a value: none of it is run again
        with known.setdefault("_making", RLock()):
            if self._name not in known:
                known[self._name] = self._make(instance)
            return known[self._name]
