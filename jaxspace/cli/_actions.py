"""The actions of the commands, with their arguments.

The commands are imported inside the functions, because importing the numerical packages takes time:
`--help` and bad options do not wait for it. Settings of jax come before the first array, which
fixes them.
"""

import argparse

from ._settings import settle


def show_examples(given: argparse.Namespace) -> int:
    """Print the example scenes by goal."""
    from . import _examples

    del given
    return _examples.show_examples()


def new(given: argparse.Namespace) -> int:
    """Copy an example scene."""
    from . import _examples

    return _examples.new(given.name, given.path)


def run(given: argparse.Namespace) -> int:
    """Run the scene or mission of the file once."""
    from . import _commands, _ephemeris

    settle(once=True)
    ephemeris = _ephemeris.EphemerisOptions(given.write, given.epoch, given.centre, given.frame)
    return _commands.run(given.file, given.out, given.show, given.modules, ephemeris)


def disperse(given: argparse.Namespace) -> int:
    """Run it many times with dispersed inputs."""
    from . import _campaigns

    settle()
    own = {name: getattr(given, name) for name in _campaigns.Options._fields}
    # Made here, because the parser must not import the package of campaigns, and gives plain
    # numbers.
    own["until"] = _campaigns.StopRule(*given.until) if given.until else None
    return _campaigns.disperse(given.file, _campaigns.Options(**own), given.out, given.modules)


def resume(given: argparse.Namespace) -> int:
    """Compute the missing runs of a store."""
    from . import _campaigns

    settle()
    return _campaigns.resume(given.file, given.engine, given.modules, given.runs)


def replay(given: argparse.Namespace) -> int:
    """Run one run of a store again, in full detail."""
    from . import _campaigns

    settle()
    return _campaigns.replay(
        given.file, given.run, given.samples, given.out, given.show, given.modules
    )


def failures(given: argparse.Namespace) -> int:
    """List the failed runs of a store."""
    from . import _campaigns

    settle()
    return _campaigns.failures(given.file, given.all, given.modules)


def diff(given: argparse.Namespace) -> int:
    """Compare two stored campaigns."""
    from . import _diff

    settle()
    return _diff.diff(given.before, given.after, given.out)


def reweight(given: argparse.Namespace) -> int:
    """Print the statistics of a stored campaign with other distributions of its inputs."""
    from . import _reweight

    settle(once=True)
    return _reweight.reweight(given.file, given.changes, given.modules)


def compare(given: argparse.Namespace) -> int:
    """Compare a flight log with the nominal run of a scene file."""
    from . import _compare

    settle()
    channels = dict(given.channels)
    return _compare.compare(
        given.file, given.log, channels, given.align, given.runs, given.out, given.modules
    )


def write_map(given: argparse.Namespace) -> int:
    """Write landings and tracks for maps and globes."""
    from . import _map

    settle(once=True)
    return _map.write_map(
        given.file, given.out, given.modules, given.tracks, given.epoch, given.angle
    )


def archive(given: argparse.Namespace) -> int:
    """Write an archive of a stored campaign, or verify one."""
    from . import _archive

    settle()
    if given.verify or given.extract is not None or given.digest is not None:
        return _archive.verify(given.file, given.digest, given.extract)
    return _archive.archive(given.file, given.out)


def report(given: argparse.Namespace) -> int:
    """Write the page and the tables of a stored campaign."""
    from . import _report

    settle()
    return _report.report(given.file, given.out, given.modules)


def explain(given: argparse.Namespace) -> int:
    """Print the table of effects of every scene of the file."""
    from . import _commands

    settle()
    return _commands.explain(given.file, given.modules)


def cost(given: argparse.Namespace) -> int:
    """Print the cost of accuracy in time."""
    from . import _commands

    settle()
    return _commands.cost(given.file, given.error, given.gradient, given.out, given.modules)


def budget(given: argparse.Namespace) -> int:
    """Print the influence of each effect on the result."""
    from . import _commands

    settle()
    return _commands.budget(given.file, given.output, given.tolerance, given.out, given.modules)


def optimize(given: argparse.Namespace) -> int:
    """Optimise the design variables of the file."""
    from . import _commands

    settle()
    return _commands.optimize(
        given.file, given.out, given.sensitivities, given.modules, given.resume
    )


def show_list(given: argparse.Namespace) -> int:
    """Print the systems, effects, events and outputs that a file may name."""
    from . import _commands

    # Without `settle`, because nothing is computed.
    return _commands.show_list(given.word, given.modules)


def show_schema(given: argparse.Namespace) -> int:
    """Print the JSON schema of scene files."""
    from . import _commands

    return _commands.show_schema(given.modules)


def programs(given: argparse.Namespace) -> int:
    """List or remove the stored programs."""
    from . import _programs

    return _programs.programs(removes=given.clear)


def verify(given: argparse.Namespace) -> int:
    """Run the singularity and edge-case checks and print the results."""
    from . import _commands

    settle()
    return _commands.verify(given.precision, given.device, given.json)
