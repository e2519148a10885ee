"""How soon a page of results can be used: opened in headless Chromium, until its figures stand."""

from __future__ import annotations

import argparse
import shutil
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from playwright.sync_api import Browser, sync_playwright

from benchmarks.measuring import show

_PAGE = Path(__file__).parent.parent / "examples" / "alpha" / "results" / "report.html"
_SIZES = {"desktop": (1280, 800), "phone": (390, 844)}  # px
_TIMES = 5
_PATIENCE = 120_000.0  # ms
_READY = "() => document.documentElement.dataset.ready"
# Without a window and a graphics processor.
_HEADLESS = ("--no-sandbox", "--enable-unsafe-swiftshader")


@dataclass(frozen=True)
class Opening:
    """A page that was opened once.

    Attributes:
        ready: wall clock from the start of its loading until all figures on its first screens
            stand and answer [s].
        busy: CPU time of the thread that runs the page until then [s].
    """

    ready: float
    busy: float


def open_once(browser: Browser, page: Path, size: tuple[int, int]) -> Opening:
    """Open a page in a context of its own, nothing kept from before.

    Args:
        browser: a browser that runs.
        page: the file.
        size: of the window [px].
    """
    context = browser.new_context(viewport={"width": size[0], "height": size[1]})
    tab = context.new_page()
    tab.set_default_timeout(_PATIENCE)
    session = context.new_cdp_session(tab)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})
    tab.goto(page.resolve().as_uri())
    tab.wait_for_function(_READY)
    metrics: list[dict[str, Any]] = session.send("Performance.getMetrics")["metrics"]
    busy = next(float(one["value"]) for one in metrics if one["name"] == "TaskDuration")
    ready = float(tab.evaluate(_READY)) / 1e3
    context.close()
    return Opening(ready, busy)


def main() -> None:
    """Open the page in windows of both sizes and tell the medians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("page", nargs="?", type=Path, default=_PAGE, help="a report.html")
    parser.add_argument("--quick", action="store_true", help="open it once in each size")
    asked = parser.parse_args()
    if not asked.page.is_file():
        parser.error(f"{asked.page}: found nothing, expected a page, as `make demo` writes it")
    chromium = shutil.which("chromium")
    if chromium is None:
        parser.error("chromium: found no such program, expected it on PATH")
    show("size of the page [MB]", asked.page.stat().st_size / 1e6, "≤ 8")
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium, args=_HEADLESS)
        for name, size in _SIZES.items():
            times = 1 if asked.quick else _TIMES
            openings = [open_once(browser, asked.page, size) for _ in range(times)]
            show(f"{name}: ready after [s]", median(o.ready for o in openings))
            show(f"{name}: CPU time of its thread [s]", median(o.busy for o in openings), "≤ 2")
        browser.close()


if __name__ == "__main__":
    main()
