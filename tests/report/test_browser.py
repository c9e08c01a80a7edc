"""The report in a real browser: headless Chromium, driven by playwright, on a file from disk."""

import os
import shutil
import subprocess
import time
from contextlib import contextmanager

import pytest

from gesturegen.motion.skeleton import Skeleton
from gesturegen.report.page import Ablation
from tests.builders import chain
from tests.report import synthetic

pytestmark = pytest.mark.slow
FLAGS = (
    "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
)  # fmt: skip
GUTTER = 48  # where the timeline begins, in timeline.js
WIDE = {"width": 1280, "height": 900}
PATIENCE = 300_000  # ms; for what never comes, so that a busy machine fails nothing


def find_chromium() -> str:
    """Debian's Chromium; a skip that says why where there is none."""
    if shutil.which("chromium") is None and os.environ.get("CI") and hasattr(os, "geteuid") and os.geteuid() == 0:
        subprocess.run(["apt-get", "install", "-y", "-q", "chromium"], check=False, capture_output=True)
    found = shutil.which("chromium")
    if found is None:
        pytest.skip("no `chromium` on the PATH: the report is not tried in a browser (apt-get install chromium)")
    return found


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is missing: pip install playwright")
    path = find_chromium()
    with playwright.sync_playwright() as driver:
        # Playwright gives every launch a user data folder of its own.
        browser = driver.chromium.launch(executable_path=path, headless=True, args=list(FLAGS))
        yield browser
        browser.close()


@contextmanager
def opened(browser, path, **options):
    """The page of a report; anything said on the console, thrown, or asked of a network is an error."""
    context = browser.new_context(**{"viewport": WIDE} | options)
    page = context.new_page()
    page.set_default_timeout(PATIENCE)
    faults = []
    page.on("console", lambda message: faults.append(message.text))
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on(
        "request",
        lambda request: None if request.url.startswith(("file:", "blob:", "data:")) else faults.append(request.url),
    )
    try:
        page.goto(path.as_uri(), wait_until="commit")
        yield page
        assert not faults
    finally:
        context.close()


def ready(page, name: str | None = None) -> None:
    page.wait_for_selector("#player[data-state=ready]")
    page.wait_for_function("() => document.getElementById('player').dataset.frame !== undefined")
    if name is not None:
        assert page.inner_text("#clip option:checked") == name


def at_frame(page, frame: int) -> None:
    """Wait until the player and every figure show the frame."""
    page.wait_for_function(
        "frame => [document.getElementById('player'), ...document.querySelectorAll('#stages canvas')]"
        ".every(element => element.dataset.frame === String(frame))",
        arg=frame,
    )


def picture(page, selector: str = "#stages canvas") -> str:
    return page.eval_on_selector(selector, "canvas => canvas.toDataURL()")


@pytest.fixture(scope="module")
def reports(tmp_path_factory):
    """Reports by what is in them, each written once."""
    folder, written = tmp_path_factory.mktemp("reports"), {}
    clips = {
        "plain": lambda: {"tst_a": synthetic.clip_text("tst_a"), "tst_b": synthetic.clip_text("tst_b", seconds=2.0)},
        "silent": lambda: {"tst_a": synthetic.clip_text("tst_a", sound=False)},
        "beside": lambda: {"tst_a": synthetic.clip_text("tst_a", labels=("generated", "truth", "weak", "other"))},
    }

    def get(kind):
        if kind not in written:
            written[kind] = synthetic.write_page(folder / f"{kind}.html", clips[kind]())
        return written[kind]

    return get


# --- playing and seeking ------------------------------------------------------------------------------------


def test_it_loads_and_draws(browser, reports):
    with opened(browser, reports("plain")) as page:
        ready(page, "tst_a")
        blank = page.evaluate("document.createElement('canvas').toDataURL()")
        assert len(picture(page)) > 5 * len(blank) and len(picture(page, "#timeline")) > 5 * len(blank)
        assert "frame 0 of 120" in page.inner_text("#readout")
        assert page.get_attribute("#player", "data-playing") != "true"


@pytest.mark.parametrize("kind", ["plain", "silent"])
def test_playing_moves_time_and_picture(kind, browser, reports):
    with opened(browser, reports(kind)) as page:
        ready(page)
        before = picture(page)
        page.check("#loop")  # or it might be at its end before a busy machine comes to look
        page.click("#play")
        page.wait_for_function("() => Number(document.getElementById('player').dataset.frame) > 8")
        page.wait_for_function("before => document.querySelector('#stages canvas').toDataURL() !== before", arg=before)
        assert page.inner_text("#play") == "Pause"
        page.click("#play")
        page.wait_for_selector("#player[data-playing=false]")
        assert page.inner_text("#play") == "Play" and page.is_hidden("#message")


@pytest.mark.parametrize("kind", ["plain", "silent"])
def test_it_stops_at_the_end_or_loops(kind, browser, reports):
    with opened(browser, reports(kind)) as page:
        ready(page)
        page.select_option("#speed", "2")
        page.focus("#stages canvas")
        page.keyboard.press("End")
        at_frame(page, 119)
        for _ in range(15):
            page.keyboard.press(",")
        at_frame(page, 104)
        page.keyboard.press("Space")
        at_frame(page, 119)
        page.wait_for_selector("#player[data-playing=false]")
        page.check("#loop")
        page.click("#play")
        # Back from the end to an earlier frame, whichever frames the browser has time to show.
        page.evaluate("""() => {
            let last = -1;
            const look = () => {
                const frame = Number(document.getElementById("player").dataset.frame);
                if (frame < last) window.looped = true;
                last = frame;
                requestAnimationFrame(look);
            };
            look();
        }""")
        page.wait_for_function("() => window.looped")
        assert page.get_attribute("#player", "data-playing") == "true"


def test_the_timeline_seeks(browser, reports):
    with opened(browser, reports("plain")) as page:
        ready(page)
        page.locator("#timeline").scroll_into_view_if_needed()
        box = page.locator("#timeline").bounding_box()
        room = box["width"] - GUTTER
        # The whole clip of 4 s is on the timeline: half of it is frame 60, in the overview and below.
        for height in (15, 130, 220):
            page.mouse.click(box["x"] + GUTTER + room * 0.5005, box["y"] + height)
            at_frame(page, 60)
            page.mouse.click(box["x"] + GUTTER + room * 0.2505, box["y"] + height)
            at_frame(page, 30)
        page.mouse.move(box["x"] + GUTTER + room * 0.1, box["y"] + 130)
        page.mouse.down()
        page.mouse.move(box["x"] + GUTTER + room * 0.7505, box["y"] + 130, steps=4)
        at_frame(page, 90)
        page.mouse.up()
        assert "join here: distance 21.0" in page.inner_text("#readout")
        assert "piece 4 of 4" in page.inner_text("#readout")


def test_everything_works_by_keyboard(browser, reports):
    with opened(browser, reports("plain")) as page:
        ready(page)
        page.focus("#stages canvas")
        for key, frame in ((".", 1), (".", 2), (",", 1), ("ArrowRight", 31), ("ArrowLeft", 1), ("End", 119),
                           (",", 118), ("Home", 0), (",", 0), ("Shift+ArrowRight", 119), ("Shift+ArrowLeft", 0)):  # fmt: skip
            page.keyboard.press(key)
            at_frame(page, frame)
        for key in ("+", "-", "a", "w", "d"):
            before = picture(page)
            page.keyboard.press(key)
            page.wait_for_function(
                "before => document.querySelector('#stages canvas').toDataURL() !== before", arg=before
            )
        page.keyboard.press("]")
        assert page.input_value("#speed") == "1.5"
        page.keyboard.press("l")
        assert page.is_checked("#loop")
        page.focus("#clip")
        page.keyboard.press("ArrowDown")
        ready(page, "tst_b")


def test_keys_outside_the_player_are_left_alone(browser, reports):
    with opened(browser, reports("plain")) as page:
        ready(page)
        page.focus(".scroll")
        page.keyboard.press(".")
        page.keyboard.press("Space")
        page.focus("#stages canvas")
        page.keyboard.press(".")
        at_frame(page, 1)


def test_the_focus_is_seen_and_everything_has_a_name(browser, reports):
    with opened(browser, reports("beside")) as page:
        ready(page)
        page.focus("#clip")
        page.keyboard.press("Tab")
        assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
        nameless = page.eval_on_selector_all(
            "button, select, input, canvas",
            "list => list.filter(e => !(e.getAttribute('aria-label') || e.textContent.trim() || (e.labels && e.labels.length)))"
            ".map(e => e.id)",
        )
        assert nameless == []


def test_a_figure_turns_and_comes_closer(browser, reports):
    with opened(browser, reports("plain")) as page:
        ready(page)
        box = page.locator("#stages canvas").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        changed = "before => document.querySelector('#stages canvas').toDataURL() !== before"
        before = picture(page)
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 90, y + 20, steps=3)
        page.mouse.up()
        page.wait_for_function(changed, arg=before)
        before = picture(page)
        page.mouse.wheel(0, -300)
        page.wait_for_function(changed, arg=before)
        assert page.evaluate("scrollY") == 0


# --- side by side, narrow, calm, dark -----------------------------------------------------------------------


def test_three_motions_run_in_step(browser, reports):
    with opened(browser, reports("beside")) as page:
        ready(page)
        assert page.locator("#stages canvas").count() == 3
        assert page.locator("#stages figcaption").all_inner_texts() == ["generated", "truth", "weak"]
        # What every picture of the browser shows of the three, however many or few it has time for.
        page.evaluate("""() => {
            window.seen = [];
            const look = () => {
                window.seen.push([...document.querySelectorAll("#stages canvas")].map(canvas => canvas.dataset.frame));
                requestAnimationFrame(look);
            };
            look();
        }""")
        page.click("#play")
        at_frame(page, 119)
        page.wait_for_selector("#player[data-playing=false]")
        seen = page.evaluate("window.seen")
        assert all(len(set(frames)) == 1 for frames in seen)
        assert {"0", "119"} <= {frames[0] for frames in seen}
        page.focus("#stages canvas")
        page.keyboard.press("Home")
        for _ in range(7):
            page.keyboard.press(".")
        at_frame(page, 7)
        pictures = page.eval_on_selector_all("#stages canvas", "list => list.map(canvas => canvas.toDataURL())")
        assert len(set(pictures)) == 3


def test_a_fourth_motion_takes_the_place_of_another(browser, reports):
    with opened(browser, reports("beside")) as page:
        ready(page)
        assert page.get_by_role("checkbox", name="other").is_disabled()
        page.get_by_role("checkbox", name="truth").uncheck()
        page.get_by_role("checkbox", name="other").check()
        page.wait_for_function("() => document.querySelectorAll('#stages canvas').length === 3")
        assert page.locator("#stages figcaption").all_inner_texts() == ["generated", "weak", "other"]
        page.select_option("#told", label="weak")
        assert "piece 1 of 4" in page.inner_text("#readout")


@pytest.mark.parametrize("kind", ["plain", "beside"])
@pytest.mark.parametrize("width", [320, 390])
def test_a_narrow_window_never_scrolls_sideways(kind, width, browser, reports):
    with opened(browser, reports(kind), viewport={"width": width, "height": 844}, has_touch=True) as page:
        ready(page)
        page.locator("details").evaluate("details => details.open = true")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        page.tap("#play")
        page.wait_for_function("() => Number(document.getElementById('player').dataset.frame) > 3")


@pytest.mark.parametrize("width", [320, 390, 1280])
def test_the_plots_of_reference_lengths_fit_and_can_be_read(width, browser, tmp_path):
    shown = Ablation(None, None, synthetic.reference_length())
    path = synthetic.write_page(tmp_path / "page.html", {"tst_a": synthetic.clip_text("tst_a")}, ablation=shown)
    with opened(browser, path, viewport={"width": width, "height": 844}) as page:
        ready(page)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        plots = page.locator("#reference-length svg.plot")
        assert plots.count() == 3
        tops = {plots.nth(k).bounding_box()["y"] for k in range(3)}
        assert len(tops) == (1 if width == 1280 else 3), "side by side, or one below the other"
        for k in range(3):
            # Every letter inside its plot, not too small, and clear of its neighbours.
            faults = plots.nth(k).evaluate("""plot => {
                const around = plot.getBoundingClientRect(), found = [];
                const boxes = [...plot.querySelectorAll("text")].map(text => [text.textContent, text.getBoundingClientRect()]);
                for (const [text, box] of boxes) {
                    if (box.left < around.left || box.right > around.right || box.bottom > around.bottom) found.push("out: " + text);
                    if (box.height < 9) found.push("small: " + text);
                    for (const [other, near] of boxes)
                        if (near !== box && near.left < box.right && box.left < near.right && near.top < box.bottom - 2 && box.top < near.bottom - 2)
                            found.push(text + " over " + other);
                }
                return found;
            }""")
            assert faults == []
        colours = plots.first.evaluate(
            "plot => [...plot.querySelectorAll('.line-0, .line-1')].map(l => getComputedStyle(l).stroke)"
        )
        assert len(set(colours)) == 2 and "none" not in colours


def test_with_reduced_motion_nothing_moves_unasked(browser, reports):
    with opened(browser, reports("plain"), reduced_motion="reduce") as page:
        ready(page)
        assert page.evaluate("document.getAnimations().length") == 0
        assert page.evaluate("getComputedStyle(document.documentElement).scrollBehavior") == "auto"
        assert page.get_attribute("#player", "data-playing") != "true"
        page.click("#play")
        page.wait_for_function("() => Number(document.getElementById('player').dataset.frame) > 3")


def test_dark_and_light_differ_and_change_on_the_spot(browser, reports):
    with opened(browser, reports("plain"), color_scheme="light") as page:
        ready(page)
        light, line = picture(page), picture(page, "#timeline")
        page.emulate_media(color_scheme="dark")
        page.wait_for_function("light => document.querySelector('#stages canvas').toDataURL() !== light", arg=light)
        assert picture(page, "#timeline") != line


# --- many, long, failed, damaged ----------------------------------------------------------------------------


def body_of_sixty() -> Skeleton:
    """As many joints as a GENEA skeleton draws."""
    names = [*[name for name, _, _ in synthetic.PERSON], *[f"b_r_index{k}" for k in range(44)]]
    person = synthetic.person()
    tail = chain(44)
    return Skeleton(
        tuple(names),
        [*person.parents, *[names.index("b_r_wrist")] * 44],
        [*person.offsets, *tail.offsets],
        [*person.end_sites, *tail.end_sites],
        (*person.channels, *[person.channels[1]] * 44),
        "HIERARCHY",
    )


@pytest.fixture(scope="module")
def hundred(tmp_path_factory):
    """A hundred clips of a minute, each of two motions with sound."""
    text = synthetic.clip_text("NAME", 60.0, ("generated", "truth"), skeleton=body_of_sixty(), shake=0.1)
    names = [f"tst_{k:03d}" for k in range(100)]
    return synthetic.write_page(
        tmp_path_factory.mktemp("hundred") / "report.html",
        {name: text.replace('"NAME"', f'"{name}"') for name in names},
    )


def test_a_hundred_clips_open_one_at_a_time_and_in_half_a_gigabyte(browser, hundred):
    assert hundred.stat().st_size > 60e6
    # How much has been read of the clips; and, as `live`, every address of sound made and not taken back.
    count = """
        window.live = window.parsed = 0;
        const [make, take, parse] = [URL.createObjectURL, URL.revokeObjectURL, JSON.parse];
        URL.createObjectURL = (blob) => { window.live++; return make.call(URL, blob); };
        URL.revokeObjectURL = (address) => { window.live--; return take.call(URL, address); };
        JSON.parse = (text, ...rest) => { window.parsed += text.length; return parse(text, ...rest); };
    """
    context = browser.new_context(viewport=WIDE)
    page = context.new_page()
    page.set_default_timeout(PATIENCE)
    page.add_init_script(count)
    start = time.monotonic()
    page.goto(hundred.as_uri(), wait_until="load")
    ready(page, "tst_000")
    seconds = time.monotonic() - start  # told, not judged: others may use the machine as well
    assert 0 < page.evaluate("window.parsed") < 1.5 * hundred.stat().st_size / 100
    session = context.new_cdp_session(page)
    session.send("Performance.enable")
    largest = 0
    for place in (99, 50, 3, 4, 5, 6, 7, 8):
        page.select_option("#clip", str(place))
        ready(page, f"tst_{place:03d}")
        figures = {m["name"]: m["value"] for m in session.send("Performance.getMetrics")["metrics"]}
        largest = max(largest, figures["JSHeapTotalSize"], memory_of_page(browser))
        assert page.evaluate("window.live") == 1
    print(
        f"{hundred.stat().st_size / 1e6:.0f} MB, open after {seconds:.1f} s, at most {largest / 1e6:.0f} MB in memory"
    )
    assert largest < 500e6
    context.close()


def memory_of_page(browser) -> float:
    """Bytes of the largest renderer process, its share of shared memory included; 0 where the system does not tell."""
    processes = browser.new_browser_cdp_session().send("SystemInfo.getProcessInfo")["processInfo"]
    sizes = [0.0]
    for process in processes:
        rollup = f"/proc/{process['id']}/smaps_rollup"
        if process["type"] == "renderer" and os.path.exists(rollup):
            with open(rollup) as lines:
                sizes += [1024.0 * int(line.split()[1]) for line in lines if line.startswith("Pss:")]
    return max(sizes)


def test_eleven_minutes(browser, tmp_path):
    path = synthetic.write_page(tmp_path / "long.html", {"long": synthetic.clip_text("long", 660.0)})
    with opened(browser, path) as page:
        ready(page)
        page.focus("#stages canvas")
        page.keyboard.press("End")
        at_frame(page, 19799)
        assert "frame 19799 of 19800" in page.inner_text("#readout")
        while page.is_enabled("#wider"):
            page.click("#wider")
        assert page.inner_text("#span") == "660 of 660 s"
        box = page.locator("#timeline").bounding_box()
        page.locator("#timeline").click(position={"x": GUTTER + (box["width"] - GUTTER) / 2, "y": 130})
        page.wait_for_function("() => Math.abs(Number(document.getElementById('player').dataset.frame) - 9900) < 40")
        before = int(page.get_attribute("#player", "data-frame"))
        page.click("#play")
        page.wait_for_function("b => Number(document.getElementById('player').dataset.frame) > b", arg=before)


def test_failed_clips_are_listed_beside_those_that_work(browser, tmp_path):
    path = synthetic.write_page(tmp_path / "some.html", {"good": synthetic.clip_text("good")}, failed=["bad"])
    with opened(browser, path) as page:
        ready(page, "good")
        assert page.locator("#failed li").all_inner_texts() == ["bad: it broke"]


def test_a_run_without_any_clip(browser, tmp_path):
    with opened(browser, synthetic.write_page(tmp_path / "none.html", {}, failed=["bad"])) as page:
        page.wait_for_selector("#failed li")
        assert page.is_hidden("#player") and "No clip of this run can be shown" in page.inner_text("main")


def test_a_damaged_clip_says_so_and_the_next_one_opens(browser, tmp_path):
    good = synthetic.clip_text("good")
    path = synthetic.write_page(
        tmp_path / "damaged.html", {"bad": good.replace('"frames":120,"par', '"frames":99,"par'), "good": good}
    )
    with opened(browser, path) as page:
        page.wait_for_selector("#player[data-state=failed]")
        assert "cannot be shown" in page.inner_text("#message")
        page.click("#next")
        ready(page, "good")
        assert page.is_hidden("#message")


def test_the_table_opens_clips_and_hostile_names_stay_text(browser, tmp_path):
    name = "<img src=x onerror=window.hacked=1>"
    path = synthetic.write_page(
        tmp_path / "names.html", {"good": synthetic.clip_text("good"), name: synthetic.clip_text(name)}
    )
    with opened(browser, path) as page:
        ready(page, "good")
        page.click("tr:nth-child(2) .open")
        ready(page, name)
        assert page.evaluate("document.activeElement.id") == "player"
        assert page.evaluate("window.hacked") is None and page.locator("main img").count() == 0
