"""The command line: it parses arguments and prints what the library returns."""

from ._main import main as main
from ._parser import parser as parser
