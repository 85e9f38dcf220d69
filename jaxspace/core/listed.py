"""Tuples returned by properties, with a helpful error if they are called like methods.

Arrays and numbers cannot do this: they are JAX and Python objects, and `orbit.period()` raises the
usual "object is not callable"."""

import functools
from collections.abc import Callable, Iterable
from typing import Any, TypeVar, cast

import jax

T = TypeVar("T")
Method = TypeVar("Method", bound=Callable[[Any], Iterable[Any]])


@jax.tree_util.register_pytree_node_class
class Listed(tuple[T, ...]):
    """A tuple that is the value of a property; tree transformations treat it as a tuple."""

    __slots__ = ()

    def __call__(self) -> None:
        raise TypeError("This is the value of a property: write the property without parentheses.")

    def tree_flatten(self) -> tuple[tuple[T, ...], None]:
        return tuple(self), None

    @classmethod
    def tree_unflatten(cls, _: None, children: Iterable[T]) -> "Listed[T]":
        return cls(children)


def no_method(method: Method) -> Method:
    """Decorator, placed between `@property` and the method, that makes the returned tuple raise a
    helpful error if it is called."""

    @functools.wraps(method)
    def give(self: object) -> Listed[Any]:
        return Listed(method(self))

    return cast(Method, give)
