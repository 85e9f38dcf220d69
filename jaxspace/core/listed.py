"""Tuples that properties give, which say so where they are called as methods.

An array and a number cannot: they are objects of JAX and of Python, and `orbit.period()` ends in
their own "object is not callable"."""

import functools
from collections.abc import Callable, Iterable
from typing import Any, TypeVar, cast

import jax

T = TypeVar("T")
Method = TypeVar("Method", bound=Callable[[Any], Iterable[Any]])


@jax.tree_util.register_pytree_node_class
class Listed(tuple[T, ...]):
    """A tuple that is the value of a property; tree transformations take it for a tuple."""

    __slots__ = ()

    def __call__(self) -> None:
        raise TypeError("This is the value of a property: write the property without parentheses.")

    def tree_flatten(self) -> tuple[tuple[T, ...], None]:
        return tuple(self), None

    @classmethod
    def tree_unflatten(cls, _: None, children: Iterable[T]) -> "Listed[T]":
        return cls(children)


def no_method(method: Method) -> Method:
    """Let the tuple of a property say what it is where it is called: between `@property` and the
    method."""

    @functools.wraps(method)
    def give(self: object) -> Listed[Any]:
        return Listed(method(self))

    return cast(Method, give)
