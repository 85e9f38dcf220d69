"""Optional libraries of an installation: each entry point names the extra that brings them."""

from types import TracebackType


class MissingExtra(ImportError):
    """A library that an extra of the installation brings is not there; the message names both."""


class extra:
    """Within it the import of a library that is not there names the extra `name` that brings it.

        with extra("app"):
            import pint

    **Raises** `MissingExtra`."""

    def __init__(self, name: str):
        self.name = name

    def __enter__(self) -> None:
        return None

    def __exit__(
        self, kind: type | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not isinstance(error, ModuleNotFoundError):
            return
        library = (error.name or "").partition(".")[0]
        # A missing module of this library is an error of the installation itself.
        if library and library != "jaxspace":
            raise MissingExtra(
                f"{library} is not installed: it comes with the extra {self.name} "
                f'(pip install "jaxspace[{self.name}]").'
            ) from None
