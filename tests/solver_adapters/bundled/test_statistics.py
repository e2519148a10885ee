from __future__ import annotations

import time

import numpy as np

from solver_adapters.bundled.statistics import Statistics


def test_components_booked_in_turn_add_up_to_the_time_that_passed() -> None:
    statistics = Statistics()
    now = begin = time.perf_counter()
    for name in ("points", "assembly", "points", "solution"):
        time.sleep(0.001)
        now = statistics.clock(name, now)
    assert set(statistics.seconds) == {"points", "assembly", "solution"}
    np.testing.assert_allclose(sum(statistics.seconds.values()), now - begin, rtol=1e-9)
    assert statistics.seconds["points"] >= 0.002
