"""Tables of a scene file, described as data: a dict of `Key`s. The description becomes a pydantic
model, and pydantic's complaints become sentences."""

from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

from ._errors import missing, unknown, wrong
from ._quantities import Choice, Quantity

REQUIRED: Any = ...


class ListOf(NamedTuple):
    """A list of `count` items of one kind; 0 is any number of them, at least `least`."""

    kind: Any
    count: int = 0
    least: int = 0


class Key(NamedTuple):
    """An entry of a table: its kind (`Quantity`, `Choice`, `ListOf`, `str`, `int`, `dict` for free
    text keys, or a table of keys) and its default."""

    kind: Any
    default: Any = REQUIRED


Table = Mapping[str, Key]


def allowed(kind: Any) -> str:
    """What a value of the kind must be, for a sentence."""
    if isinstance(kind, Quantity | Choice):
        return kind.allowed()
    if isinstance(kind, ListOf):
        count = f"{kind.count} " if kind.count else f"at least {kind.least} " if kind.least else ""
        return f"a list of {count}entries, each {allowed(kind.kind)}"
    if isinstance(kind, Mapping):
        return f"a table with the keys {', '.join(kind)}" if kind else "an empty table"
    return {str: "text", int: "a whole number above zero", dict: "a table"}[kind]


def model(name: str, table: Table) -> Any:
    """The pydantic model of a table; a key that is not described is an error."""
    from pydantic import ConfigDict, create_model

    fields: dict[str, Any] = {}
    for key, spec in table.items():
        annotation = _annotation(key, spec.kind)
        fields[key] = (annotation | None if spec.default is None else annotation, spec.default)
    config = ConfigDict(extra="forbid", protected_namespaces=(), validate_default=True)
    return create_model(name, __config__=config, **fields)


def _annotation(name: str, kind: Any) -> Any:
    from pydantic import Field, PlainValidator, StrictStr

    if isinstance(kind, Quantity | Choice):
        return Annotated[Any, PlainValidator(kind.read)]
    if isinstance(kind, ListOf):
        least, most = (kind.count, kind.count) if kind.count else (kind.least, None)
        return Annotated[
            list[_annotation(name, kind.kind)], Field(min_length=least, max_length=most)
        ]
    if isinstance(kind, Mapping):
        return model(name, kind)
    return {str: StrictStr, int: Annotated[int, Field(strict=True, gt=0)], dict: dict[str, Any]}[
        kind
    ]


def checked(table: Table, data: Any) -> tuple[dict[str, Any], list[str]]:
    """The values of a table with defaults filled in, or the sentences that say what is wrong with
    it."""
    from pydantic import ValidationError

    try:
        return _plain(model("file", table).model_validate(data)), []
    except ValidationError as error:
        return {}, [_sentence(table, complaint) for complaint in error.errors(include_url=False)]


def _plain(value: Any) -> Any:
    """Models as dicts, all the way down; numbers as they are, with what they measure."""
    fields = getattr(type(value), "model_fields", None)
    if fields is not None:
        return {name: _plain(getattr(value, name)) for name in fields}
    return [_plain(v) for v in value] if isinstance(value, list) else value


def _sentence(table: Table, complaint: Any) -> str:
    where = complaint["loc"]
    key = ".".join(map(str, where))
    kind, parent = _kind_at(table, where), _kind_at(table, where[:-1])
    if complaint["type"] == "extra_forbidden":
        return unknown(key, where[-1], parent)
    if complaint["type"] == "missing":
        return missing(key, allowed(kind))
    if complaint["type"] == "value_error":
        return wrong(key, complaint["input"], str(complaint["ctx"]["error"])).replace("?.", "?")
    return wrong(key, complaint["input"], allowed(kind))


def _kind_at(table: Table, where: tuple[Any, ...]) -> Any:
    kind: Any = table
    for step in where:
        if isinstance(kind, ListOf):
            kind = kind.kind
        elif isinstance(kind, Mapping) and step in kind:
            kind = kind[step].kind
    return kind
