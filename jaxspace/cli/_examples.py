"""The example scenes: which there are for which goal, and a copy of one to begin with."""

import re
import shutil
import tomllib
from pathlib import Path

from ..core import InputError
from ..io import example
from ..io.examples import scenes

GOALS: dict[str, tuple[str, ...]] = {
    "Monte Carlo dispersion": (
        "kick_stage",
        "transfer_payload",
        "landing",
        "intercept",
    ),
    "Launch to orbit": (
        "launch",
        "gimballed_ascent",
        "dispersed_ascent",
        "pad_to_orbit",
        "booster_return",
        "gravity_turn",
    ),
    "Orbit propagation": (
        "two_body",
        "explorer_7",
        "molniya",
        "lunar_distance",
        "low_thrust_spiral",
        "low_orbit_to_geostationary",
    ),
    "Guidance and control": (
        "powered_landing",
        "windy_landing",
        "upright_landing",
        "air_brake",
        "roll_control",
        "flexible_gains",
        "sampled_slew",
        "wheel_slew",
    ),
    "Rigid-body rotation": (
        "top",
        "top_loops",
        "top_waves",
        "eraser_least",
        "eraser_intermediate",
        "eraser_greatest",
        "thrown_disk",
        "settling_coin",
        "dual_spin",
    ),
    "Instruments and mechanisms": (
        "gyrocompass",
        "two_gimbal_gyro",
        "stable_platform",
        "inertial_navigator",
        "double_pendulum",
        "trailer",
        "flexible_missile",
        "flexible_stage",
    ),
}
"""The scenes by topic, introductory ones first."""
# Commands of a scene besides `run`, by the corresponding table.
COMMANDS = {"disperse": "dispersion", "optimize": "optimize"}


def show_examples() -> int:
    """Print the scenes by topic, each with its title and its commands."""
    names = [name for group in GOALS.values() for name in group]
    width = max(map(len, names))
    for goal, group in GOALS.items():
        print(f"to {goal}")
        for name in group:
            path = scenes() / f"{name}.toml"
            title = tomllib.loads(path.read_text(encoding="utf-8"))["title"]
            print(f"  {name:<{width}}  {title} ({', '.join(['run', *_made_for(path)])})")
        print()
    print("`jaxspace new NAME` copies one into the current folder.")
    return 0


def new(name: str, path: str | None) -> int:
    """Copy a scene to `path`, by default NAME.toml in the current folder, together with the files
    that it names.

    **Raises** `InputError` for an unknown name, and where there is a file already."""
    source = example(name)
    target = Path(f"{name}.toml" if path is None else path)
    text = source.read_text(encoding="utf-8")
    # Each by its name only: the copies are in the same folder.
    beside = {named: target.parent / Path(named).name for named in _named_files(text)}
    for path_there in (target, *beside.values()):
        if path_there.exists():
            raise InputError(f"{path_there} exists already: give a path that does not exist.")
    for named, copy in beside.items():
        text = text.replace(f'"{named}"', f'"{copy.name}"')
        shutil.copyfile(scenes() / named, copy)
    target.write_text(text, encoding="utf-8")
    for copy in (target, *beside.values()):
        print(f"file   {copy}")
    for command in ("run", *_made_for(target)):
        print(f"next   jaxspace {command} {target}")
    return 0


def _named_files(text: str) -> list[str]:
    """The files that a scene names, relative to the folder of the scenes."""
    result = re.findall(r'"([^"\n]+\.(?:eng|csv))"', text)
    return list(dict.fromkeys(result))


def _made_for(path: Path) -> list[str]:
    """The commands that a scene is made for, besides `run`."""
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    return [command for command, table in COMMANDS.items() if table in data]
