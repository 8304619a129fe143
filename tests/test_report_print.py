"""The report on paper, as a Chromium that is installed would print it."""

import chromium
import made_results as made
import numpy as np
import pytest
from PIL import Image

from mpcplan.report.write import write_report

pytestmark = chromium.MARKS

PAPER = 1039  # px between the margins of the stylesheet: A4 across less 11 mm twice
MANY = 210  # more rows than are shown at once on the screen
NAMES = ["with the default configuration", "without association", "safe_distance_of_others", "game"]
TOO_WIDE = """() => [...document.querySelectorAll("main *")].filter((element) =>
  !element.closest("svg, .figure") && element.getBoundingClientRect().right > innerWidth + 1
).map((element) => `${element.tagName} of ${element.closest("section").id}`)"""
VISIBLE = "element => element.checkVisibility()"


def everything(scenario: str, number: int) -> dict:
    """A row with all columns that the page may show."""
    cells = {"R_G1": 3.675, "R_G1_kept": "not regained", "R_G4": -12.25, "bound": 1.0, "gap": 14.02}
    if number % 10 == 0:
        return made.failed(scenario, f"collided at step {number}", status="not_solved", **cells)
    return made.solved(scenario, 100.0 + number, **cells)


@pytest.fixture
def paper(browser, tmp_path):
    """Four runs with many columns and long names, about to be printed."""
    places = ("Town", "SantBoideLlobregat", "SanGiorgioaCremano")
    ids = [made.id_of(n, places[n % 3]) for n in range(MANY)]
    ids[5] = made.id_of(5, "Village" * 4)
    folders = []
    for run in range(len(NAMES)):
        rows = [everything(one, n) for n, one in enumerate(ids if run == 0 else ids[:30])]
        if run % 2:
            rows = [{**row, "kind": "interactive"} for row in rows]
        folders.append(made.write(tmp_path / f"run{run}", rows))
    picture = folders[0] / "pictures" / f"{ids[0]}.png"
    picture.parent.mkdir()
    Image.fromarray(np.zeros((2000, 1500, 3), np.uint8)).save(picture)
    out = tmp_path / "r.html"
    write_report(folders, out, NAMES)
    page = browser.new_page(viewport={"width": PAPER, "height": 710})
    page.goto(out.as_uri())
    page.wait_for_function("document.documentElement.dataset.figures === 'ready'")
    yield page
    page.close()


def begin(page) -> None:
    """What a browser does before it prints."""
    page.emulate_media(media="print")
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")


def test_nothing_is_wider_than_the_page(paper):
    paper.locator("#rows tr.row .open-row").first.click()
    paper.locator("tr.detail img").evaluate("image => image.decode()")
    begin(paper)
    assert paper.locator("#maps table.dense").count() == 1  # the widest is there
    assert paper.evaluate(TOO_WIDE) == []
    figures = paper.locator(".figure").evaluate_all(
        "all => all.map((one) => one.getBoundingClientRect().right)"
    )
    assert len(figures) > 10 and max(figures) <= PAPER
    assert paper.locator("tr.detail img").bounding_box()["height"] < 710  # one page


def test_all_chosen_rows_are_printed_and_the_screen_is_as_before(paper):
    total = MANY + 30 * (len(NAMES) - 1)
    assert paper.locator("#rows tr.row").count() == 200
    begin(paper)
    assert paper.locator("#rows tr.row").count() == total
    assert paper.locator("#count").inner_text() == f"{total} of {total} rows"
    paper.evaluate("window.dispatchEvent(new Event('afterprint'))")
    assert paper.locator("#rows tr.row").count() == 200
    assert paper.locator("#rows tr.why").count() == 0


def test_what_is_chosen_and_why_rows_failed_is_told(paper):
    paper.locator("#choices select[data-column=status]").select_option("not_solved")
    paper.locator("#search").fill("Town step")
    paper.locator('#rows thead button:text-is("driven")').click()
    assert not paper.locator("#chosen").is_visible()
    begin(paper)
    told = paper.locator("#chosen").inner_text()
    assert "status not_solved" in told and "“Town step”" in told and "by driven" in told
    causes = paper.locator("#rows tr.why").all_inner_texts()
    assert len(causes) == paper.locator("#rows tr.row").count() > 0
    assert all(cause.strip().startswith("collided at step") for cause in causes)


def test_what_only_a_click_could_use_is_not_printed(paper):
    paper.locator("#rows tr.row .open-row").first.click()
    begin(paper)
    for what in ("nav", ".filters", "#more", ".links", ".on-screen"):
        shown = paper.locator(what).evaluate_all("all => all.map((one) => one.checkVisibility())")
        assert shown and not any(shown), what
    assert paper.locator("#rows tr.detail").evaluate(VISIBLE)


def test_heads_can_be_repeated(paper):
    """Chromium repeats no head that holds the box of a button on the pages that follow."""
    begin(paper)
    boxes = paper.locator("#rows th button").evaluate_all(
        "all => all.map((one) => getComputedStyle(one).display)"
    )
    assert set(boxes) == {"contents"}
