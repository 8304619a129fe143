"""How far off predictions were, measured on the traffic that a benchmark has simulated."""

from pathlib import Path

import numpy as np
import pytest
from fake_traffic import FakeTraffic, interactive

from mpcplan import cli
from mpcplan.bench.forecasts import HEADER, forecast_errors
from mpcplan.errors import InputError
from mpcplan.scenario import load
from mpcplan.simulate import loop
from mpcplan.simulate.loop import drive
from mpcplan.simulate.simulated_scenario import write_simulated
from mpcplan.trajectory import State

BUNDLED = Path(__file__).parents[1] / "scenarios" / "ZAM_FreeRoad-1_1_T-1.xml"
SPEED = 12.0  # m/s, of the truck ahead


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a run behind a truck of constant speed."""
    folder = tmp_path_factory.mktemp("results") / "solutions"
    loaded = interactive(load(BUNDLED))
    x, y, psi = loaded.problems[0].start[[State.X, State.Y, State.PSI]]
    box = np.array([x + 60 * np.cos(psi), y + 60 * np.sin(psi), psi, SPEED, 8.0, 2.5])
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop, "open_traffic", lambda *_: FakeTraffic(box))
        run = drive(loaded)
    run.write_solution(folder)
    write_simulated(loaded, run.drives[0].others, folder / f"{loaded.id}.simulated.cr.xml")
    return folder.parent


def test_the_errors_of_both_predictions_by_kind_and_time(results):
    constant, lanes = forecast_errors(results)
    assert (constant.kind, lanes.kind) == ("constant_input", "lane_follow")
    for found in (constant, lanes):
        assert {row.kind for row in found.rows} == {"truck", "all"}
        assert {row.seconds for row in found.rows} == {1.0, 2.0, 3.0}
        counts = [row.number for row in found.rows if row.kind == "truck"]
        assert counts == sorted(counts, reverse=True) and counts[-1] > 0
    assert max(row.p95 for row in constant.rows) < 1e-6  # its speed is constant
    # along the lanes it is expected to speed up on the free road: a v t^2 / 2 at most
    at_three = next(row for row in lanes.rows if row.seconds == 3.0)
    assert 0.5 < at_three.mean < 1.3 * 3.0**2 / 2


def test_the_command_prints_a_table_and_writes_it(results, tmp_path, capsys):
    table = tmp_path / "errors.csv"
    assert cli.main(["forecasts", str(results), "--csv", str(table)]) == cli.OK
    out = capsys.readouterr().out.splitlines()
    assert out[0].startswith("displacement of the centres [m], spread") and out[1].split() == list(
        HEADER
    )
    lines = table.read_text().splitlines()
    assert lines[0] == ",".join(HEADER) and len(lines) == len(out) - 1
    assert lines[1].startswith("constant_input,truck,1,")


def test_folders_without_simulated_traffic_are_refused(tmp_path, results):
    with pytest.raises(InputError, match="no simulated traffic"):
        forecast_errors(tmp_path)
    lonely = tmp_path / "x.simulated.cr.xml"
    lonely.write_bytes(next(results.rglob("*.simulated.cr.xml")).read_bytes())
    with pytest.raises(InputError, match="no solution of x beside it"):
        forecast_errors(tmp_path)
    broken = tmp_path / "solution_KS1:TR1:x:2020a.xml"
    broken.write_text("<CommonRoadSolution")
    with pytest.raises(InputError, match="not a readable solution"):
        forecast_errors(tmp_path)
