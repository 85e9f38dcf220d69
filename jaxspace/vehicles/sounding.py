"""A sounding from a file, as data, as an atmosphere and as a wind; `_sounding_file` has the
formats."""

__all__ = ["Sounding", "read_sounding"]

import os

from ..core.printing import printed
from ._measured_air import MeasuredAtmosphere, MeasuredWind
from ._sounding_file import SoundingFile, read_sounding_file


@printed(heights="m", pressure="Pa", temperature="K", wind_heights="m", east="m/s", north="m/s")
class Sounding(SoundingFile):
    """Measurements of a sounding, by the geometric height above sea level.

    - `heights`, m, with `pressure`, Pa, and `temperature`, K, there.
    - `wind_heights`, m, with the wind there, m/s, towards `east` and `north`.

    Empty where the file has none of these. `air_fault` and `wind_fault` explain why the file
    provides no atmosphere or no wind (too few levels, or a gap between them); they are empty
    otherwise."""

    __slots__ = ()

    def atmosphere(self) -> MeasuredAtmosphere:
        """The atmosphere of its pressures and temperatures. Raises `InputError` without them, and
        for a gap of more than 6 km."""
        return MeasuredAtmosphere(*self.air_levels())

    def wind(self) -> MeasuredWind:
        """The wind of its directions and speeds. Raises `InputError` without them, and for a gap
        of more than 6 km."""
        return MeasuredWind(*self.wind_levels())


def read_sounding(path: str | os.PathLike[str]) -> Sounding:
    """The sounding of a file: text or CSV of the University of Wyoming, a file of SPC or SHARPpy
    with %RAW%, the lines of one sounding of IGRA (version 2), or any CSV with these columns.

    **Arguments**

    - `path`: of the file, at most 64 MB.

    **Raises** `InputError` with the file, its line, the value and the allowed values: for invalid
    numbers, values out of range, heights that do not ascend, pressures that do not decrease, and
    several soundings in one file. `OSError` for a file that cannot be opened.

    A level where a value is missing (an empty field, `nan`, -9999) is left out of the atmosphere or
    of the wind. Pressures may be equal at two levels that are so close that rounding hides the
    difference.
    """
    return Sounding(*read_sounding_file(path))
