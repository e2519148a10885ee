"""Why the correlation of an image stopped, and what to try."""

from __future__ import annotations

from driver.dic.system import MAX_ITERATIONS, MIN_USED, End


def explanation(end: End, tolerance: float) -> str:
    """One sentence; with a remedy where the iteration did not converge.

    Args:
        end: where it stopped.
        tolerance: that was asked for [px].
    """
    if end.reason == "converged":
        return f"update of u, v below {tolerance:g} px"
    if end.reason == "left":
        return (
            f"stopped after {end.iterations} steps: less than {100 * MIN_USED:.0f} % of the pixels "
            "stay in the image or on measured heights; try a smaller mask, or look at the image"
        )
    if end.reason == "diverged":
        return (
            f"diverged: the last update was {end.last_update:.2g} px; try larger elements of u, v, "
            "or a smaller roughness"
        )
    return (
        f"no convergence in {MAX_ITERATIONS} steps: the last update was {end.last_update:.2g} px; "
        "try larger elements of u, v, a smaller roughness, or a finer mesh of w where the "
        "topography changed"
    )
