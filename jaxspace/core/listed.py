"""Tuples that properties give, which say so where they are called as methods."""

from typing import TypeVar

T = TypeVar("T")


class Listed(tuple[T, ...]):
    """A tuple of names, sentences or rows that is the value of a property. It holds no arrays: a
    tree transformation takes it for a leaf."""

    __slots__ = ()

    def __call__(self) -> None:
        raise TypeError("This is the value of a property: write the property without parentheses.")
