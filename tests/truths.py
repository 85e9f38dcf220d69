"""Computes the truths of the hard cases and stores them: `python tests/truths.py [NAME ...]`.

Values by `twins.py` in sixty digits; derivatives by central differences of these, whose steps
leave twenty digits. Without names, all cases whose inputs are not stored yet."""

import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context

import twins
from mpmath import mp, mpf

from jaxspace.verification import CASES, Case
from jaxspace.verification._case import TRUTHS

STEP = mpf(10) ** -15
ZERO_STEP = mpf(10) ** -28
SHOWN = 20


def truth(case: Case) -> dict[str, list]:
    """Value and derivatives of a case as text."""
    function = getattr(twins, case.function.__name__)
    mp.dps = twins.DIGITS
    inputs = [mpf(x) for x in case.inputs]
    columns = []
    for number, x in enumerate(inputs):
        # A zero may stand beside small numbers, which say what is near.
        h = STEP * abs(x) or ZERO_STEP
        ahead, behind = (
            function([*inputs[:number], x + step, *inputs[number + 1 :]]) for step in (h, -h)
        )
        columns.append([(a - b) / (2 * h) for a, b in zip(ahead, behind, strict=True)])
    try:
        value = function(inputs)
    except ZeroDivisionError:
        # A hole of the formula that the function has not: the mean of both sides.
        shifts = ([x + s * STEP for x in inputs] for s in (1, -1))
        value = [(a + b) / 2 for a, b in zip(*map(function, shifts), strict=True)]
    return {
        "inputs": list(case.inputs),
        "value": [mp.nstr(x, SHOWN) for x in value],
        "slopes": [[mp.nstr(c[row], SHOWN) for c in columns] for row in range(len(value))],
    }


def stored(case: Case, record: dict) -> bool:
    """Whether the truth of these inputs is there."""
    return record["cases"].get(case.name, {}).get("inputs") == list(case.inputs)


def main() -> None:
    record = json.loads(TRUTHS.read_text()) if TRUTHS.exists() else {"cases": {}}
    names = sys.argv[1:]
    wanted = [
        case
        for case in CASES
        if case.value is None and (case.name in names if names else not stored(case, record))
    ]
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        jobs = {pool.submit(truth, case): case for case in wanted}
        for job in as_completed(jobs):
            case = jobs[job]
            if job.exception():
                print("FAILED", case.name, job.exception(), flush=True)
                continue
            found = job.result()
            record["cases"][case.name] = found
            print(case.name, flush=True)
            store(record)


def store(record: dict) -> None:
    """In the order of the cases, and without those that are gone."""
    names = [c.name for c in CASES if c.value is None and c.name in record["cases"]]
    text = {"made by": "python tests/truths.py", "cases": {n: record["cases"][n] for n in names}}
    TRUTHS.write_text(json.dumps(text, indent=0) + "\n")


if __name__ == "__main__":
    main()
