"""The record of how a result was made, as JSON can hold it."""

from typing import Any, TypeAlias

# `Any`, because Python's types cannot say what JSON holds without a cast at every reading.
Record: TypeAlias = dict[str, Any]
"""Texts, numbers, lists and further records, by name."""
