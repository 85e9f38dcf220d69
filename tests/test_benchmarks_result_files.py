"""The results of benchmarks: which instructions they are of, and how the page shows two sets."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from benchmarks import page, result_files  # noqa: E402


@pytest.mark.parametrize(
    "flags, limit, found",
    [
        ({"sse4_2", "avx2", "avx512f"}, "", "avx512"),
        ({"sse4_2", "avx2", "avx512f"}, "AVX2", "avx2 of avx512"),
        ({"sse4_2", "avx2"}, "AVX512", "avx2"),
        ({"sse4_2", "avx2"}, "SSE4_2", "sse4_2 of avx2"),
        ({"sse4_2"}, "AVX2", "sse4_2"),
    ],
)
def test_the_instructions_are_those_of_processor_and_compiler(monkeypatch, flags, limit, found):
    monkeypatch.setattr(result_files, "_flags", lambda: flags)
    monkeypatch.setattr(result_files.platform, "machine", lambda: "x86_64")
    monkeypatch.setenv("XLA_FLAGS", f"--xla_cpu_max_isa={limit}" if limit else "")
    assert result_files.described() == found
    assert result_files.instructions() == found.partition(" ")[0]


def test_an_unknown_processor_has_the_name_of_its_kind(monkeypatch):
    monkeypatch.setattr(result_files, "_flags", set)
    monkeypatch.setattr(result_files.platform, "machine", lambda: "riscv64")
    monkeypatch.setenv("XLA_FLAGS", "--xla_cpu_max_isa=AVX2")
    assert result_files.instructions() == "riscv64"


def test_both_sets_stand_in_one_table(monkeypatch, tmp_path):
    monkeypatch.setattr(result_files, "RESULTS", tmp_path / "results")
    monkeypatch.setattr(page, "PAGE", tmp_path / "benchmarks.md")
    for kind, rate in (("avx2", 2e6), ("avx512", 5e6)):
        rows = {"ours": {"runs_per_second": rate, "cores": 1.0}, f"only {kind}": {"cores": 2.0}}
        result_files.write(
            "kepler", kind, {"what": "Orbits.", "machine": {"cores": 2}, "rows": rows}
        )
    page.write(("kepler", "lambert"))
    text = (tmp_path / "benchmarks.md").read_text()
    assert "| | runs per second | cores | runs per second, AVX2 |" in text
    assert "| ours | 5e+06 | 1 | 2e+06 |" in text
    assert "only avx512" in text and "only avx2" not in text
    assert "*AVX-512: cores 2; AVX2: cores 2*" in text
    assert "Lambert" not in text
