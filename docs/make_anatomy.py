"""Draws the pictures of anatomy.md and prints its table: sampled, refined, bound.

Usage: python docs/make_anatomy.py
"""

import tempfile
from dataclasses import replace
from pathlib import Path

from mpcplan.bound.judged import bound_of_run
from mpcplan.config import Config
from mpcplan.config.files import load_config
from mpcplan.scenario import load
from mpcplan.score.judge import judge_run
from mpcplan.score.tr1 import CHECKER_WEIGHTS, PARTS, tr1
from mpcplan.show.comparison import Compared, plot_comparison
from mpcplan.simulate.loop import drive

ROOT = Path(__file__).resolve().parents[1]
SCENARIOS = ("ZAM_LaneChange-1_1_T-1", "ZAM_TJunction-1_1_T-1", "ZAM_CutIn-1_1_T-1")
SAMPLING = ROOT / "configs" / "sampling_only.yaml"


def anatomy(name: str, folder: Path) -> list[Compared]:
    """One scenario, driven by the samples alone and refined, and its bound."""
    loaded, compared = load(ROOT / "scenarios" / f"{name}.xml"), []
    for label, config in (("sampled", load_config(SAMPLING)), ("refined", Config())):
        run = drive(loaded, config)
        judgement = judge_run(run, folder / label)
        assert judgement.verdict.parts is not None, f"{name}, {label}: {judgement.verdict.cause}"
        compared.append(Compared(label, run, judgement.verdict.parts))
    found = bound_of_run(run, judgement, folder / "bound")
    assert found.verdict.parts is not None  # the bound is valid
    bound = Compared("bound", found.run, found.verdict.parts)
    best = min(bound, compared[1], key=lambda one: tr1(one.parts))  # the drive may be the bound
    return [*compared, replace(best, name="bound")]


def main() -> None:
    """All scenarios."""
    print(f"| Scenario | Drive | TR1 | {' | '.join(PARTS)} |")
    print("|---" * (3 + len(PARTS)) + "|")
    for name in SCENARIOS:
        with tempfile.TemporaryDirectory() as folder:
            compared = anatomy(name, Path(folder))
        plot_comparison(compared, ROOT / "docs" / "images" / f"anatomy_{name}.png")
        for one in compared:
            parts = " | ".join(f"{CHECKER_WEIGHTS[p] * one.parts[p]:.3f}" for p in PARTS)
            print(f"| {name} | {one.name} | {tr1(one.parts):.3f} | {parts} |", flush=True)


if __name__ == "__main__":
    main()
