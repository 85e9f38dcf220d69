"""`jaxspace optimize` of a file whose search is over the runs of its [dispersion]."""

import contextlib
import os
from collections.abc import Iterator

from ..io import SceneFile
from ..optimization import Progress
from ..robust import DesignAssessment, DesignOptimum, assess_designs
from ._output import make_folder, replacing, write_text
from ._waiting import progress, waiting


def optimize_design(file: SceneFile, folder: str, resume: bool) -> int:
    """Optimise the design variables over the runs of the file, assess the optimum and the original
    design with independent runs, print the table, and save the file of the optimum, a page and two
    figures."""
    make_folder(folder)
    beginning = os.path.join(folder, file.path.stem)
    store = f"{beginning}_search.npz"
    # A new search replaces the state of an old one.
    if not resume and os.path.exists(store):
        os.remove(store)
    with search_progress(file.values["optimize"]["max_steps"]) as show:
        optimum = file.optimize_design(show, store=store, resume=resume)
    with waiting("the nominal optimum, for comparison"):
        nominal = file.optimize_design(nominal=True)
    with waiting("assessing the optimum with independent runs"):
        assessment = assess_designs(optimum, {"file": optimum.start, "nominal": nominal.x})
    print(file.title)
    print(assessment)
    print(optimum.sentence())
    _keep(file, beginning, optimum, assessment)
    if optimum.converged:
        os.remove(store)
    else:
        print(f"store  {store}")
    print(f"next   jaxspace disperse {beginning}_optimum.toml")
    return 0 if optimum.converged else 1


@contextlib.contextmanager
def search_progress(most: int) -> Iterator[Progress]:
    """A progress bar of a search with `most` steps at most: step, upper bound of the remaining
    time, objective, violation and gradient. The yielded function is called after each step."""
    # Most searches converge long before their last step, and nobody knows when.
    line = "{desc}: {n_fmt} of at most {total_fmt} steps in {elapsed}"
    left = f"{line}, at most {{remaining}} more{{postfix}}"
    with progress("compiling the search", total=most, bar_format=left) as bar:

        def show(step: int, objective: float, violation: float, gradient: float) -> None:
            if not bar.n:
                bar.set_description_str("searching", refresh=False)
                # A search that is resumed has taken the steps before it.
                bar.initial = bar.n = step - 1
            bar.update(step - bar.n)
            bar.set_postfix_str(
                f"objective {objective:.4g}, violation {violation:.1e}, gradient {gradient:.1e}"
            )

        yield show
        bar.bar_format = f"{line}{{postfix}}"


def _keep(
    file: SceneFile, beginning: str, optimum: DesignOptimum, assessment: DesignAssessment
) -> None:
    """Write the file of the optimum, its page, and the figures of its runs and of the search."""
    best = f"{beginning}_optimum.toml"
    write_text(best, file.with_design(optimum))
    print(f"file   {best}")
    page = f"{beginning}_designs.html"
    with replacing(page) as unfinished:
        assessment.page(unfinished, file.title)
    print(f"page   {page}")
    for ending, figure in (
        ("_designs.png", assessment.plot(title=file.title)),
        ("_search.png", optimum.plot(file.title)),
    ):
        with replacing(beginning + ending) as unfinished:
            figure.savefig(unfinished)
        print(f"figure {beginning + ending}")
