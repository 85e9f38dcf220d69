"""Writes `reference/nesc` from the files of NASA's check-cases: `python -m validation._thin_nesc
FOLDER`, with the folder `Atmospheric_checkcases` of github.com/nasa/simupy-flight."""

import csv
import sys
from pathlib import Path

REFERENCE = Path(__file__).parent / "reference" / "nesc"
# Of the names of the files: what is compared.
COLUMNS = (
    "altitudeMsl_ft",
    "longitude_deg",
    "latitude_deg",
    "feVelocity_ft_s_X",
    "feVelocity_ft_s_Y",
    "feVelocity_ft_s_Z",
    "eulerAngle_deg_Yaw",
    "eulerAngle_deg_Pitch",
    "eulerAngle_deg_Roll",
    "bodyAngularRateWrtEi_deg_s_Roll",
    "bodyAngularRateWrtEi_deg_s_Pitch",
    "bodyAngularRateWrtEi_deg_s_Yaw",
)
# Of the case whose model is looked into.
MORE = {
    "17": (
        "dynamicPressure_lbf_ft2",
        "aero_bodyForce_lbf_X",
        "aero_bodyForce_lbf_Z",
        "aero_bodyMoment_ftlbf_M",
    )
}
# Seconds between the rows that stay.
EVERY = 2.0


def main(folder: Path) -> None:
    """One file of each case, with a row of each simulator and time."""
    REFERENCE.mkdir(parents=True, exist_ok=True)
    for case in (*(f"{k:02d}" for k in range(1, 11)), "17"):
        columns = (*COLUMNS, *MORE.get(case, ()))
        lines = [["simulator", "time_s", *columns]]
        for file in sorted(folder.glob(f"Atmos_{case}_*/Atmos_{case}_sim_*.csv")):
            with file.open(newline="") as source:
                for row in csv.DictReader(source):
                    time = float(row["time"])
                    # The clocks of some simulators add their steps.
                    if abs(time - EVERY * round(time / EVERY)) < 1e-6:
                        values = (row.get(name, "nan") for name in columns)
                        numbers = (f"{float(value):.13g}" for value in values)
                        lines.append([file.stem[-2:], f"{round(time)}", *numbers])
        with (REFERENCE / f"atmospheric_{case}.csv").open("w", newline="") as target:
            csv.writer(target, lineterminator="\n").writerows(lines)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
