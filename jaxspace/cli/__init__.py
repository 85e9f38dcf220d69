"""The command line: it parses arguments and prints what the library returns."""

from ._main import main as main
from ._main import parser as parser
