"""The report in a browser: a Chromium that is installed, without a window."""

from contextlib import contextmanager

import chromium
import made_results as made
import numpy as np
import pytest
from PIL import Image

from mpcplan.report.write import write_report
from mpcplan.show.film import write_film

READY = "document.documentElement.dataset.table === 'ready'"
DRAWN = "[...document.querySelectorAll('.figure')].every((f) => f.querySelector('.main-svg'))"

pytestmark = chromium.MARKS


@contextmanager
def opened(browser, out, beside=()):
    """A report, loaded; fails where the console told an error, or more than this was loaded."""
    errors, asked = [], []
    shown = browser.new_page()
    shown.on("console", lambda told: errors.append(told.text) if told.type == "error" else None)
    shown.on("pageerror", lambda error: errors.append(str(error)))
    shown.on("request", lambda request: asked.append(request.url))
    shown.goto(out.as_uri())
    shown.wait_for_function(READY)
    yield shown
    shown.close()
    assert errors == []
    asked = {url for url in asked if not url.startswith(("data:", "blob:"))}
    assert asked == {out.as_uri(), *(path.as_uri() for path in beside)}


@pytest.fixture
def page(browser, tmp_path):
    """The report of two runs without pictures, which loads nothing but itself."""
    out = tmp_path / "r.html"
    write_report(made.two_runs(tmp_path), out)
    with opened(browser, out) as shown:
        yield shown


def _column(page, label: str) -> list[str]:
    """The visible cells of a column of the table of scenarios."""
    heads = page.locator("#rows thead th").all_inner_texts()
    at = [head.strip() for head in heads].index(label) + 1
    return [
        cell.strip() for cell in page.locator(f"#rows tr.row td:nth-child({at})").all_inner_texts()
    ]


def _sort(page, label: str) -> None:
    page.locator(f'#rows thead button:text-is("{label}")').click()


def test_all_figures_are_drawn(page):
    page.wait_for_function(DRAWN)
    assert page.locator(".figure").count() == 7  # without rules, bounds and traces


def test_headings_sort_and_empty_cells_come_last(page):
    assert len(_column(page, "scenario")) == 11
    _sort(page, "TR1")
    rising = ["1.000", "1.000", "2.000", "4.000", "10.000", "10.000", "100.000"]
    assert _column(page, "TR1") == [*rising, *[""] * 4]
    assert page.locator("#rows th[aria-sort=ascending]").inner_text().strip() == "TR1"
    _sort(page, "TR1")
    assert _column(page, "TR1") == [*reversed(rising), *[""] * 4]
    assert page.locator("#rows th[aria-sort=descending]").inner_text().strip() == "TR1"


def test_choices_and_words_filter_until_they_are_reset(page):
    page.locator("#choices select[data-column=run]").select_option("second")
    assert _column(page, "run") == ["second"] * 6
    page.locator("#choices select[data-column=status]").select_option("solved")
    assert len(_column(page, "scenario")) == 4
    page.locator("#choices select[data-column=map]").select_option("DEU_Village")
    assert _column(page, "scenario") == []
    page.locator("#clear").click()
    assert len(_column(page, "scenario")) == 11
    page.locator("#search").fill("COLLIDED step 9")  # words of a cause, whatever their case
    assert _column(page, "scenario") == [made.id_of(5)]
    assert page.locator("#count").inner_text() == "1 of 11 rows"


def test_counts_lead_to_their_scenarios_and_rows_open(page):
    page.locator("#against .pick").nth(1).click()
    assert _column(page, "scenario") == [made.id_of(3, "Village")] * 2
    assert "only A" in page.locator("#picked").inner_text()
    page.locator("#rows tr.failed .open-row").click()
    told = page.locator("#rows tr.detail").inner_text()
    assert "the goal was not reached at step 30" in told and "no picture" in told
    page.locator("#rows tr.open .open-row").click()
    assert page.locator("#rows tr.detail").count() == 0


@pytest.fixture
def seen(tmp_path):
    """Two runs; the first has a picture and a film of scenario 1, as `show` makes them."""
    folders = made.two_runs(tmp_path)
    picture = folders[0] / "pictures" / f"{made.id_of(1)}.png"
    film = folders[0] / "animations" / f"{made.id_of(1)}.mp4"
    for path in (picture, film):
        path.parent.mkdir()
    frame = np.full((120, 160, 3), 200, np.uint8)
    Image.fromarray(frame).save(picture)
    write_film([frame] * 10, film, 10.0, [frame])
    return folders, picture, film


@pytest.mark.parametrize("embed", [False, True])
def test_a_row_shows_its_picture_and_plays_its_film(browser, seen, tmp_path, embed):
    out = tmp_path / "r.html"
    folders, picture, film = seen
    write_report(folders, out, embed=embed)
    with opened(browser, out, [film] if embed else [picture, film]) as page:
        page.locator("#rows tr.row .open-row").first.click()
        image = page.locator("tr.detail img")
        image.evaluate("image => image.decode()")
        assert image.evaluate("image => image.naturalWidth") == 160
        assert image.get_attribute("src").startswith("data:" if embed else "first/pictures/")
        page.wait_for_function("document.querySelector('video').readyState > 0")
        assert page.locator("video").evaluate("film => film.duration") == pytest.approx(1.0)
        page.locator("video").evaluate("film => { film.muted = true; return film.play(); }")
        page.wait_for_function("document.querySelector('video').currentTime > 0.2")


def test_files_that_are_gone_are_told(browser, seen, tmp_path):
    out = tmp_path / "r.html"
    folders, *files = seen
    write_report(folders, out)
    for path in files:
        path.unlink()
    page = browser.new_page()  # whose console tells the missing files as errors
    page.goto(out.as_uri())
    page.locator("#rows tr.row .open-row").first.click()
    gone = page.locator("tr.detail .missing", has_text="is not there (any more)")
    gone.nth(1).wait_for()
    told = gone.all_inner_texts()
    assert [path.name in text for path, text in zip(files, told, strict=True)] == [True, True]
    page.close()
