"""Why the correlation of an image stopped, and what to try."""

from __future__ import annotations

from driver.dic.system import MIN_USED, End

NOT_FOUND = 0.5
"""Of the relief; what leaves more, and did not converge, shows another place or another surface."""


def explanation(end: End, tolerance: float, left: float) -> str:
    """One sentence; with a remedy where the iteration did not converge.

    Args:
        end: where it stopped.
        tolerance: that was asked for [px].
        left: root mean square of the residual over that of the relief.
    """
    if end.reason == "converged":
        if end.last_update < tolerance:
            return f"update of u, v below {tolerance:g} px"
        return (
            f"last update of u, v {end.last_update:.2g} px, {end.last_sigma:.1g} σ of what is read"
        )
    if end.reason == "left":
        return (
            f"stopped after {end.iterations} steps: less than {100 * MIN_USED:.0f} % of the pixels "
            "stay in the image or on measured heights; try a smaller mask, or look at the image"
        )
    why = f"no convergence in {end.iterations} steps"
    if end.reason == "diverged":
        why = "diverged"
    why += f": the last update was {end.last_update:.2g} px"
    if left > NOT_FOUND:
        return (
            f"{why}, and {100 * left:.0f} % of the relief are left: its motion was not found; try "
            "images in between, in Python a start, or look at the image: focus, field, orientation"
        )
    if end.last_sigma < 1.0:
        return f"{why}, {end.last_sigma:.1g} σ of what is read; try a larger tolerance"
    return (
        f"{why}; try larger elements of u, v, a smaller roughness, or a finer mesh of w where the "
        "topography changed"
    )
