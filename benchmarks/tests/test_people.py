from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from benchmarks.people import open_once

playwright = pytest.importorskip("playwright.sync_api", reason="the package playwright is absent")
CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed")

BUSY, IDLE = 0.3, 0.4  # s
PAGE = f"""<!DOCTYPE html><script>
setTimeout(() => {{
  const began = performance.now();
  while (performance.now() < began + {1e3 * BUSY});
  document.documentElement.dataset.ready = Math.round(performance.now());
}}, {1e3 * IDLE});
</script>"""


def test_a_page_that_works_and_waits_is_ready_after_both_and_busy_with_one(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text(PAGE)
    with playwright.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        found = open_once(browser, tmp_path / "a.html", (390, 844))
        browser.close()
    assert found.ready >= BUSY + IDLE
    # On a loaded machine the thread has the processor for a part of its loop only.
    assert 0.1 * BUSY < found.busy < found.ready
