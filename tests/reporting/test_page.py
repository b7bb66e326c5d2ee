"""The page in a real browser: no error, no request, and it plays.

Without Chromium these tests are skipped, but not in CI.
"""

import json
import os
import re
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from helpers_rows import VARIANTS, crashed, made_row, made_rows, write_rows, write_traces
from helpers_trace import crossing_trace
from playwright.sync_api import Browser, BrowserContext, Page, sync_playwright

from sumo_mcts.commands import report as command
from sumo_mcts.records import ROW_KEYS, load_trace, save_trace
from sumo_mcts.reporting import tables

CHROMIUM = (
    shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
)
EVIL = "<script>window.evil=1</script>&\"'{{title}}"
CRASHED = "left--mcts-idm-100--0"


def report(folder: Path) -> Path:
    return command.report([folder], folder, ["report", str(folder)], lambda _: None).files[0]


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two scenes, two twins that fail, a trace that is broken, one of a newer format, and names
    that want to be escaped."""
    rows = made_rows(6)
    rows += [
        made_row(EVIL, EVIL, 0, error=EVIL, outcome="error", ego=EVIL, key="evil"),
        crashed(made_row("left", "paper", 3)),
    ]
    manifest = {
        "experiment": {"name": "trial " + EVIL, "description": "Two scenes."},
        "versions": {"sumo": "1.28.0"},
    }
    result = write_rows(tmp_path_factory.mktemp("results"), rows, manifest)
    write_traces(result, CRASHED, "left--mcts-idm-100--3", "evil")
    whole = (result / "traces" / f"{CRASHED}.npz").read_bytes()
    (result / "traces" / "exit--mcts-idm-100--0.npz").write_bytes(whole[:2000])
    np.savez_compressed(result / "traces" / "exit--mcts-idm-100--3.npz", format=np.array(99))
    return result


@pytest.fixture(scope="session")
def path(folder: Path) -> Path:
    """The report of the folder."""
    return report(folder)


@pytest.fixture(scope="module")  # no longer: other tests look at this process's children
def browser() -> Iterator[Browser]:
    if CHROMIUM is None:
        assert not os.environ.get("CI"), "in CI a browser has to be there"
        pytest.skip("no Chromium")
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield started
        started.close()


def visit(context: BrowserContext, path: Path, fragment: str = "") -> tuple[Page, list[str]]:
    """The page, and what went wrong on it so far: errors, and requests for anything but itself."""
    page, wrong = context.new_page(), list[str]()
    page.on(
        "console",
        lambda message: (
            wrong.append(message.text) if message.type in ("error", "warning") else None
        ),
    )
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on(
        "request",
        lambda request: (
            None
            if request.url.partition("#")[0] == path.as_uri() or request.url.startswith("data:")
            else wrong.append(request.url)
        ),
    )
    page.goto(path.as_uri() + fragment)
    return page, wrong


@pytest.fixture
def context(browser: Browser) -> Iterator[BrowserContext]:
    made = browser.new_context(viewport={"width": 1280, "height": 800}, color_scheme="light")
    made.set_default_timeout(10_000)
    yield made
    made.close()


def opened(
    context: BrowserContext, path: Path, key: str = CRASHED, at: float = 0.0
) -> tuple[Page, list[str]]:
    page, wrong = visit(context, path, f"#replay={key}&t={at}")
    until(page, "player !== null")
    return page, wrong


def until(page: Page, expression: str) -> None:
    """Wait for a condition; playwright's own way of it is not allowed by the page's security
    policy."""
    end = time.monotonic() + 10.0
    while not page.evaluate(expression):
        assert time.monotonic() < end, expression
        page.wait_for_timeout(20)


def colours(page: Page) -> dict[str, int]:
    """How many pixels of the road have which colour."""
    found: dict[str, int] = page.evaluate(
        """() => { const c = document.getElementById("road"), d = c.getContext("2d").getImageData(0, 0, c.width, c.height).data, n = {};
                   for (let i = 0; i < d.length; i += 4) { const k = `${d[i]},${d[i + 1]},${d[i + 2]}`; n[k] = (n[k] || 0) + 1; } return n; }"""
    )
    return found


# --- the page ---


@pytest.mark.slow
def test_it_opens_without_an_error_or_a_request(context: BrowserContext, path: Path) -> None:
    page, wrong = visit(context, path)
    assert page.locator("h1").inner_text() == "trial " + EVIL
    assert page.evaluate("window.evil") is None
    assert page.locator("#table-outcomes tbody tr").count() == 10
    assert page.locator(".tiles:visible").count() == 1
    page.select_option("#scene", "left")
    assert page.locator(".figures:visible svg").count() == 6
    assert wrong == []


@pytest.mark.slow
def test_nothing_but_the_page_is_on_the_page(context: BrowserContext, path: Path) -> None:
    """The packed replays are no text to read, and nothing is wider than the window."""
    page, _ = visit(context, path)
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    assert not page.evaluate("[...document.scripts].some((script) => script.checkVisibility())")


@pytest.fixture(scope="module")
def wide(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Seven variants, short and long names, a few pairs in one scene and more in the other, in some
    of which somebody has to brake."""
    names = ["mcts", "mcts-careful-headway", "mcts-100", "mwwm", "idm", "constant", "sumo"]
    rows = [
        made_row(scene, name, seed)
        for scene, seeds in (("unprotected-left-turn", 3), ("highway-exit-varied", 8))
        for name in names
        for seed in range(seeds)
    ]
    for row in rows:
        if row["planner"] != "sumo" and row["seed"] < 2:
            row.update(
                imposed_brakes_2=1,
                imposed_brakes_3=1,
                imposed_brakes_4=1,
                outcome="timeout",
                travel_time_s=None,
            )
    return report(write_rows(tmp_path_factory.mktemp("wide"), rows))


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_cut_off_at_the_width_of_a_projector(
    scheme: str, browser: Browser, wide: Path
) -> None:
    context = browser.new_context(viewport={"width": 1280, "height": 800}, color_scheme=scheme)  # type: ignore[arg-type]
    page, wrong = visit(context, wide)
    assert page.evaluate("all('.scroll').every((box) => box.scrollWidth <= box.clientWidth)"), (
        "tables fit"
    )
    for scene in ("unprotected-left-turn", "highway-exit-varied"):
        page.select_option("#scene", scene)
        assert page.evaluate(
            "all('figure').filter((f) => f.checkVisibility()).every((figure) => figure.scrollWidth "
            "<= figure.clientWidth)"
        ), "figures fit"
        inside = """all('.figures:not([hidden]) svg').every((svg) => { const box = svg.getBoundingClientRect();
            return all('text', svg).every((text) => { const b = text.getBoundingClientRect(); return b.left >= box.left && b.right <= box.right + 1; }); })"""
        assert page.evaluate(inside), "labels are whole"
    swatches = page.evaluate(
        "all('.legend .swatch').map((swatch) => getComputedStyle(swatch).backgroundColor)"
    )
    assert len(swatches) == len(set(swatches)) == 7, "every variant has its colour"
    assert wrong == []
    context.close()


def test_a_few_pairs_have_no_interval_and_are_no_alarm(context: BrowserContext, wide: Path) -> None:
    page, _ = visit(context, wide)
    for scene, judged in (("unprotected-left-turn", False), ("highway-exit-varied", True)):
        rows = page.locator('#table-twin tr[data-variant="mcts-careful-headway"]')
        cell = rows.filter(has_text=scene).locator("td").last
        assert ("▲" in cell.inner_text(), ".." in cell.inner_text()) == (judged, judged), (
            scene,
            cell.inner_text(),
        )


@pytest.mark.parametrize("time", ["abc", "-5", "1e9"])
def test_an_address_with_a_time_that_is_none_shows_a_moment_all_the_same(
    time: str, context: BrowserContext, path: Path
) -> None:
    page, wrong = visit(context, path, f"#replay={CRASHED}&t={time}")
    until(page, "player !== null")
    assert "NaN" not in page.locator("#replay").inner_text() and wrong == []


def test_the_tables_show_what_was_counted(context: BrowserContext, path: Path) -> None:
    page, _ = visit(context, path)
    row = page.locator("#table-outcomes tr", has_text="mcts-idm-100").first
    assert re.sub(r"\s+", " ", row.inner_text()).split(" ")[2:] == [
        "6",
        "4/6",
        "30..90.3",
        "%",
        "2/6",
        "9.7..70",
        "%",
        "2/6",
        "9.7..70",
        "%",
        "",
    ]


def test_columns_sort_both_ways_and_unknown_comes_last(context: BrowserContext, path: Path) -> None:
    page, _ = visit(context, path)
    header = page.locator("#table-others th", has_text="TTC")

    def shown() -> list[str]:
        return page.locator("#table-others tbody tr").evaluate_all(
            "rows => rows.map(row => "
            f"row.cells[{header.evaluate('th => th.cellIndex')}].textContent)"
        )

    header.get_by_role("button").focus()
    page.keyboard.press("Enter")
    up = shown()
    assert header.get_attribute("aria-sort") == "ascending"
    page.keyboard.press("Enter")
    assert header.get_attribute("aria-sort") == "descending"
    known = [float(text) for text in up if text != "-"]
    assert known == sorted(known)
    assert [float(text) for text in shown() if text != "-"] == known[::-1]


@pytest.mark.slow
def test_choosing_a_scene_and_a_variant(context: BrowserContext, path: Path) -> None:
    page, wrong = visit(context, path)
    page.select_option("#scene", "exit")
    assert page.locator(".figures:visible").get_attribute("data-scene") == "exit"
    page.select_option("#focus", "idm")
    assert page.locator(".tiles:visible .big").first.inner_text() == "12of 12"
    page.select_option("#with", "idm")
    rows = page.locator("#table-variants tbody tr:visible")
    assert rows.count() > 0
    assert all(
        "idm"
        in (rows.nth(k).get_attribute("data-variant"), rows.nth(k).get_attribute("data-against"))
        for k in range(rows.count())
    )
    assert wrong == []


def test_a_measure_is_explained_to_pointer_and_keyboard(
    context: BrowserContext, path: Path
) -> None:
    page, _ = visit(context, path)
    page.locator("#table-outcomes th", has_text="Collisions").hover()
    assert "contact of the ego with another agent" in page.locator("#tip").inner_text()
    page.mouse.move(0, 0)
    page.locator("#table-outcomes th", has_text="At fault").get_by_role("button").focus()
    page.keyboard.press("Shift+Tab")
    assert "contact of the ego with another agent" in page.locator("#tip").inner_text()


@pytest.mark.slow
def test_light_and_dark(browser: Browser, path: Path) -> None:
    brightness = (
        "getComputedStyle(document.body).backgroundColor.match(/\\d+/g).slice(0, "
        "3).reduce((sum, channel) => sum + Number(channel), 0)"
    )
    for scheme, dark in (("light", False), ("dark", True)):
        context = browser.new_context(color_scheme=scheme)  # type: ignore[arg-type]
        page, wrong = visit(context, path)
        assert (page.evaluate(brightness) < 300) == dark
        page.get_by_role("button", name="Switch between light and dark").click()
        assert (page.evaluate(brightness) < 300) != dark
        page.reload()
        assert (page.evaluate(brightness) < 300) != dark, "the choice stays"
        assert wrong == []
        context.close()


def test_what_is_missing_is_told(context: BrowserContext, path: Path) -> None:
    page, _ = visit(context, path)
    notes = page.locator("#notes li").all_inner_texts()
    assert len(notes) == 2
    assert "no replay of exit--mcts-idm-100--0" in notes[0]
    assert "not a whole trace" in notes[0]
    assert "trace format 99" in notes[1]
    assert page.locator('tr[data-key="left--paper--3"]').inner_text().startswith("no trace")


def test_a_narrow_window_scrolls_within_its_tables(browser: Browser, path: Path) -> None:
    context = browser.new_context(viewport={"width": 380, "height": 800})
    page, _ = visit(context, path)
    assert page.evaluate("document.documentElement.scrollWidth") <= 380
    context.close()


# --- a replay ---


def test_the_replay_shows_the_road_and_the_decision_of_the_moment(
    context: BrowserContext, path: Path
) -> None:
    trace = crossing_trace()
    cycle = trace.cycles[6]
    page, wrong = opened(context, path, at=cycle.time + 0.1)
    assert colours(page)["18,92,224"] > 200, "the ego is there, in its colour"
    assert (
        page.locator("#facts div", has_text="speed").locator("dd").inner_text()
        == f"{cycle.ego.v:.1f} m/s"
    )
    rows = page.locator("#actions tbody tr")
    assert rows.count() == len(cycle.decision.children)
    best = sorted(
        range(len(cycle.decision.children)), key=lambda i: (cycle.decision.children[i].best, i)
    )
    assert rows.nth(0).locator("td.visits").inner_text() == str(
        cycle.decision.children[best[0]].visits
    )
    chosen = page.locator("#actions tr.chosen")
    assert chosen.count() == 1
    assert (
        chosen.locator("td").nth(0).inner_text().replace("\u2212", "-")
        == f"{cycle.decision.children[cycle.decision.chosen].accel:+.1f}"
    )
    assert wrong == []


@pytest.mark.slow
def test_an_action_that_is_pointed_at_is_drawn(context: BrowserContext, path: Path) -> None:
    page, _ = opened(context, path, at=3.0)
    before = colours(page)["18,92,224"]
    page.locator("#actions tbody tr:not(.chosen)").first.hover()
    assert colours(page)["18,92,224"] > before


@pytest.mark.slow
def test_it_tells_why_the_fail_safe_acted(
    context: BrowserContext, path: Path, folder: Path
) -> None:
    page, _ = opened(context, path)
    assert page.locator("#failsafe").is_hidden()
    page.keyboard.press("n")
    page.keyboard.press("n")
    assert (
        page.locator("#failsafe").inner_text()
        == load_trace(folder / "traces" / f"{CRASHED}.npz").cycles[12].decision.reason
    )
    assert page.locator("#failsafe").is_visible()


@pytest.mark.slow
def test_playing(context: BrowserContext, path: Path) -> None:
    page, wrong = opened(context, path)
    page.get_by_role("button", name="Faster").click()
    page.get_by_role("button", name="Faster").click()
    assert page.locator("#rate").inner_text() == "4×"
    page.get_by_role("button", name="Play", exact=True).click()
    until(page, "player.time > 1.5")
    before = page.evaluate("player.moment.ego.y")
    page.get_by_role("button", name="Pause").click()
    stopped = page.evaluate("player.time")
    page.wait_for_timeout(150)
    assert page.evaluate("player.time") == stopped
    assert before > crossing_trace().cycles[0].ego.y, "the ego drives north"
    page.evaluate("player.seek(player.end - 0.4)")
    page.get_by_role("button", name="Play", exact=True).click()
    until(page, "!player.playing")
    assert page.evaluate("player.time === player.end"), "it ends at the end"
    assert wrong == []


def test_scrubbing(context: BrowserContext, path: Path) -> None:
    page, _ = opened(context, path)
    page.locator("#scrub").fill("7.25")
    assert page.locator("#clock").inner_text().startswith("7.3 s") or page.locator(
        "#clock"
    ).inner_text().startswith("7.2 s")
    assert page.locator("#facts dd").first.inner_text() == f"15 of {len(crossing_trace().cycles)}"
    x, y, *_ = page.evaluate("[player.moment.ego.x, player.moment.ego.y]")
    a, b = crossing_trace().cycles[14].ego, crossing_trace().cycles[15].ego
    first = crossing_trace().cycles[0].ego
    np.testing.assert_allclose(
        [x + np.floor(first.x), y + np.floor(first.y)],
        [(a.x + b.x) / 2, (a.y + b.y) / 2],
        atol=0.011,
    )


@pytest.mark.slow
def test_the_keyboard(context: BrowserContext, path: Path) -> None:
    page, wrong = opened(context, path)
    times = [cycle.time for cycle in crossing_trace().cycles]

    def press(*keys: str) -> float:
        for key in keys:
            page.keyboard.press(key)
        return float(page.evaluate("player.time"))

    assert press("ArrowRight", "ArrowRight", "ArrowRight") == times[3]
    assert press("ArrowLeft") == times[2]
    assert press("End") == times[-1]
    assert press("ArrowRight") == times[-1]
    assert press("Home", "ArrowLeft") == times[0]
    press("+", "+", "-")
    assert page.locator("#rate").inner_text() == "2×"
    press("Space")
    until(page, "player.time > 0.3")
    press("Space")
    assert not page.evaluate("player.playing")
    assert page.evaluate("document.activeElement.id") == "play", (
        "the focus stays where it can be seen"
    )
    page.keyboard.press("Tab")
    assert page.evaluate(
        "document.activeElement.matches(':focus-visible') && "
        "document.getElementById('replay').contains(document.activeElement)"
    )
    page.keyboard.press("Escape")
    assert page.locator("#replay").is_hidden()
    assert page.evaluate("player") is None
    assert wrong == []


def test_it_opens_from_the_list_and_shows_the_outcome_at_the_end(
    context: BrowserContext, path: Path
) -> None:
    page, _ = visit(context, path)
    page.locator(f'tr[data-key="{CRASHED}"]').get_by_role("button", name="Replay").click()
    until(page, "player !== null")
    assert page.locator("#replay-title").inner_text() == CRASHED
    assert page.locator("#replay-why").inner_text() == "collision at fault"
    page.keyboard.press("End")
    assert page.locator("#facts div", has_text="outcome").locator("dd").inner_text() == "arrived", (
        "the trace's own"
    )
    assert f"#replay={CRASHED}&t=" in page.url


def test_what_was_tried_is_told_with_its_lane(context: BrowserContext, tmp_path: Path) -> None:
    """In the order of the table: the cheapest first."""
    trace, row = crossing_trace(), made_row()
    cycle = trace.cycles[6]
    children = [
        child._replace(lane_change=k % 3 - 1)
        for k, child in enumerate(sorted(cycle.decision.children, key=lambda child: child.best))
    ]
    changed = cycle._replace(decision=cycle.decision._replace(children=tuple(children), chosen=0))
    cycles = (*trace.cycles[:6], changed, *trace.cycles[7:])
    save_trace(
        write_rows(tmp_path, [row]) / "traces" / f"{row['key']}.npz",
        trace._replace(key=row["key"], cycles=cycles),
    )
    page, wrong = opened(context, report(tmp_path), row["key"], at=cycle.time)
    heads = page.locator("#actions th").all_inner_texts()
    told = page.locator("#actions tbody tr").evaluate_all(
        f"rows => rows.map(row => row.cells[{heads.index('lane')}].textContent)"
    )
    assert told == [{1: "← left", -1: "→ right", 0: ""}[child.lane_change] for child in children]
    assert page.evaluate(
        "document.querySelector('aside').scrollWidth <= document.querySelector('aside').clientWidth"
    ), "nothing is cut off"
    page.locator("#facts div", has_text="known ends").hover()
    assert "had been simulated before" in page.locator("#tip").inner_text()
    assert wrong == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("Zoom in", "player.road.zoom"),
        ("Zoom out", "player.road.zoom"),
        ("Slower", "player.rate"),
        ("Faster", "player.rate"),
    ],
)
def test_what_plus_and_minus_do_is_told_and_done(
    name: str, changes: str, context: BrowserContext, path: Path
) -> None:
    page, _ = opened(context, path)
    button, before = page.get_by_role("button", name=name, exact=True), page.evaluate(changes)
    group = button.locator("xpath=..")
    assert (
        group.get_attribute("role") == "group"
        and ("zoom" if "Zoom" in name else "speed") in group.inner_text()
    )
    button.click()
    assert (page.evaluate(changes) > before) == (name in ("Zoom in", "Faster"))


def test_every_control_has_a_name(context: BrowserContext, path: Path) -> None:
    page, _ = opened(context, path)
    named = "e => e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length"
    nameless = page.evaluate(
        f"[...document.querySelectorAll('button, input, select')].filter(e => !({named})(e)).length"
    )
    assert nameless == 0


@pytest.mark.parametrize("trouble", ["unknown", "broken"])
def test_a_replay_that_is_not_there_says_so(
    trouble: str, context: BrowserContext, path: Path, tmp_path: Path
) -> None:
    text, path = path.read_text(), tmp_path / "report.html"
    path.write_text(
        re.sub(r'(class="replay" data-key="' + CRASHED + '">).{4000}', r"\1", text)
        if trouble == "broken"
        else text
    )
    page, wrong = visit(context, path, f"#replay={CRASHED if trouble == 'broken' else 'nobody'}")
    until(page, "!document.getElementById('trouble').hidden")
    assert page.locator("#trouble").inner_text().startswith("This replay cannot be shown: ")
    assert wrong == []


# --- without a browser ---


def test_what_is_written(folder: Path, tmp_path: Path) -> None:
    made = command.report([folder], tmp_path, ["report"], lambda _: None)
    assert {path.name for path in tmp_path.iterdir()} == {"report.html", "report.md", "tables"}
    assert {path.stem for path in (tmp_path / "tables").iterdir()} == set(made.document["tables"])
    assert json.loads(json.dumps(made.document, allow_nan=False))["episodes"] == 50
    text = (tmp_path / "report.html").read_text()
    assert not re.search(r"(src|href)\s*=\s*[\"'](?!#|data:)", text), "nothing is fetched"
    assert "## Notes" in (tmp_path / "report.md").read_text()
    again = command.report([folder], tmp_path, ["report"], lambda _: None)
    assert again.document == made.document
    assert (tmp_path / "report.html").read_text() == text, "the same folder, the same page"


def test_every_measure_of_a_table_has_a_definition() -> None:
    assert [
        column.key
        for table in tables.tables(made_rows(2))
        for column in table.columns
        if not column.about
    ] == []


def test_rows_of_which_nothing_is_known_have_a_page(tmp_path: Path) -> None:
    bare = {"key": "a", "scenario": "s", "variant": "v", "outcome": "error"}
    assert set(bare) < set(ROW_KEYS)
    path = report(
        write_rows(tmp_path, [bare, {**bare, "key": "b", "planner": "sumo", "variant": "w"}])
    )
    assert "up to 2 of 2 rows are of another version" in path.read_text()


@pytest.mark.slow
def test_ten_thousand_episodes_take_seconds(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    rows = [
        made_row(
            scene,
            variant,
            seed,
            travel_time_s=float(rng.normal(20, 3)),
            min_ttc_s=float(rng.exponential(4)),
            imposed_brakes_3=int(rng.integers(2)),
        )
        for scene in ("left", "exit", "straight", "ring", "ramp")
        for variant in (*VARIANTS, "constant")
        for seed in range(400)
    ]
    write_rows(tmp_path, [crashed(row) if rng.random() < 0.02 else row for row in rows])
    before = time.process_time()
    path = report(tmp_path)
    assert time.process_time() - before < 30.0
    assert len(rows) == 10_000
    assert path.stat().st_size < 2e6
