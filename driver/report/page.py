"""The report page: what stands in it, and its rendering."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from driver.case.grains import Grain
from driver.case.specimen import Specimen
from driver.common.formatting import chi, joined, number
from driver.experiment.images.stated_noise import COST, contradiction
from driver.experiment.orientations import GrainOrientation, grain_orientations
from driver.experiment.reading import fitted_loads
from driver.report.figures import side_labels
from driver.report.findings import Findings
from driver.report.first_screen import FirstScreen
from driver.report.identified_texts import identification
from driver.report.labels import cause_label
from driver.report.measured_texts import difference_text, texts
from driver.report.plotting_library import FLAT, SOLID, bundle, licence
from driver.report.references import REFERENCES
from driver.report.slip import slip_section
from driver.report.style import INDEXED, data_uri
from driver.report.tables import cause_rows, localisation_rows, parameter_rows
from driver.report.verdict import tests_told
from driver.report.view import View
from templates import render

TEMPLATE = "report.html.j2"
Row = dict[str, Any]
_FEW = ("Law", "Added", "Apex amplitudes")  # groups of parameters that are shown at once

_CELLS = {10: "tetrahedra", 20: "hexahedra"}  # by their number of nodes
# Scripts, styles and tags take no index; what stands between them does.
_TEXT = re.compile(rf"(<script.*?</script>|<style.*?</style>|<[^>]*>)|{INDEXED.pattern}", re.DOTALL)


def report_page(
    findings: Findings,
    head: FirstScreen,
    view: View,
    figures: Mapping[str, bytes],
    title: str,
    date: str,
    version: str,
    files: Mapping[str, str],
) -> str:
    """Return the page as HTML.

    Args:
        findings: the results.
        head: what stands first.
        view: what is shown image by image.
        figures: PNG files by name; those of the rounds are "evidence_1", "evidence_2", …
        title: name of the case.
        date: when the report was written.
        version: version of prismid.
        files: what each result file holds, by name.
    """
    shifts = parameter_rows(findings) if findings.extended else []
    content = {
        "extended": findings.extended,
        "diagnosed": findings.diagnosed,
        "model": side_labels(findings.sides)[findings.sides[-1]],
        "facts": facts(findings),
        "measured": texts(findings.motion),
        "difference": difference_text(findings.motion, _difference(findings)),
        "chi_text": chi_text(findings),
        "identified": identification(findings),
        "slip": slip_section(findings),
        "groups": [group for group in shifts if group[0] in _FEW],
        "other_groups": [group for group in shifts if group[0] not in _FEW],
        "figures": {name: data_uri(image) for name, image in figures.items()},
        "references": REFERENCES,
        "files": files,
    }
    if findings.diagnosed:
        content |= _diagnosis(findings)
    return rendered(TEMPLATE, head, view, title, date, version, content)


def rendered(
    template: str,
    head: FirstScreen,
    view: View,
    title: str,
    date: str,
    version: str,
    content: Mapping[str, Any],
) -> str:
    """Return a page with its first screen, its view and the library that draws it.

    Args:
        template: file name of it.
        head: what stands first.
        view: what is shown image by image.
        title: name of the case.
        date: when the report was written.
        version: version of prismid.
        content: the values that this template names beside these.
    """
    page = render(
        template, head=head, title=title, date=date, version=version, view=view.content,
        arrays=view.arrays.text, flat=bundle(FLAT), solid=bundle(SOLID),
        licence=licence(), **content,
    )  # fmt: skip
    return _TEXT.sub(lambda found: found[1] or f"{found[2]}<sub>{found[3]}</sub>", page)


def _diagnosis(findings: Findings) -> Row:
    """Return what the page says of a diagnosis."""
    diagnosis, declared = findings.diagnosis, findings.declared
    places, phases = localisation_rows(diagnosis["whereabouts"])
    return {
        "whereabouts": diagnosis["whereabouts"]["text"],
        "places": places,
        "phases": phases,
        "untried": untried(findings),
        "stress": [grain["text"] for grain in diagnosis["critical_stress"]],
        "rounds": [
            {
                "number": index,
                "figure": f"evidence_{index}",
                "chi_load": chi(step["chi_load"]),
                "chi_image": chi(step["chi_image"]),
                "named": [cause_label(name) for name in step["named"]],
                "omnibus": tests_told(step["omnibus"]),
                "accepted": step["omnibus"]["accepted"],
                "rows": cause_rows(step, declared),
            }
            for index, step in enumerate(diagnosis["steps"], start=1)
        ],
    }


def _difference(findings: Findings) -> tuple[float, float, float]:
    """Root mean square of measured less modelled u, v, w at the last peak, means removed [µm]."""
    peak = findings.peaks[-1]
    gap = (
        findings.measured["motion"][peak] - findings.predicted[f"{findings.sides[-1]}/motion"][peak]
    )
    u, v, w = np.std(gap, axis=0, dtype=np.float64).tolist()
    return u, v, w


def chi_text(findings: Findings) -> str:
    """Return which χ_F is which: of the diagnosis, of the identification, of the literature."""
    ended = float(findings.identified["budget/load"])
    plain = float(findings.identified["paper/chi_F"][1])
    text = "χ_F counts what mesh and time steps may leave wrong as noise."
    if findings.diagnosed:
        before = findings.budgets["before"]["load"]
        text += (
            f" The identification ended at χ_F = {chi(ended)}; the diagnosis takes the error of "
            f"mesh and steps at the identified values, and so begins with the same model at "
            f"{chi(before)}."
        )
    return (
        f"{text} Over γ_F alone, as in the tables of the literature, that model is at {chi(plain)}."
    )


def untried(findings: Findings) -> list[str]:
    """Sentences on what the verdict does not speak of: causes not tried, loads left out."""
    case, diagnosis = findings.case, findings.diagnosis
    sentences = []
    if case.diagnosis.causes != "all":
        sentences.append("Of the library only the causes that the case asks for were tried.")
    by_reason: dict[str, list[str]] = {}
    for name, why in diagnosis["not_examined"].items():
        by_reason.setdefault(why, []).append(cause_label(name))
    sentences += [f"Not examined: {joined(names)}; {why}." for why, names in by_reason.items()]
    if case.loads.left_out:
        numbers = [str(image) for image in sorted(case.loads.left_out)]
        what = "load of image" if len(numbers) == 1 else "loads of images"
        sentences.append(f"The case leaves out the {what} {joined(numbers)}.")
    for bad in diagnosis["bad_loads"]:
        sentences.append(
            f"The load of image {bad['image']} is left out: it is off by "
            f"{number(bad['off_uN'])} µN, {number(bad['sigmas'], 2)} of its standard deviations."
        )
    return sentences


def _orientation(grain: Grain, found: GrainOrientation) -> str:
    """Return a grain with its Bunge angles, and where they are from."""
    if found.of_map is None:
        return f"{grain.name} ({', '.join(f'{angle:g}°' for angle in found.euler_deg)})"
    angles = ", ".join(f"{angle:.2f}°" for angle in found.euler_deg)
    spread = np.rad2deg(found.of_map.spread)
    return (
        f"{grain.name} ({angles}, mean of {found.of_map.points} points of {grain.ebsd} "
        f"that spread by {spread:.2g}°)"
    )


def facts(findings: Findings) -> list[tuple[str, str]]:
    """Specimen, images and simulation in a few lines."""
    case, m = findings.case, findings.measured
    s = case.specimen
    grains = "; ".join(map(_orientation, case.grains, grain_orientations(case)))
    peak = float(np.nanmax(fitted_loads(case, m["force"])))
    ratio = findings.travel_ratio
    reference = f"reference: mean of {float(m['n_reference']):g}"
    ends = [("motion of the ends", ratio.sentence())] if ratio else []
    stated = case.images.repeats is None
    left = [str(frame) for frame, out in enumerate(m["left_out"]) if out and (frame or not stated)]
    fate = "is unlike its" if len(left) == 1 else "are unlike their"
    but = f"; {joined(left)} {fate} neighbours and not fitted but for the load" if left else ""
    return [
        ("specimen" if s.of_mesh else s.shape,
         f"{s.length:g} × {s.width:g} × {s.depth:.3g} µm (Y, X, Z), "
         f"section {number(case.section)} µm²"),
        ("grains (Bunge angles)", grains),
        ("mesh", f"{len(findings.mesh.cells)} quadratic "
                 f"{_CELLS[findings.mesh.cells.shape[1]]}, "
                 f"{len(findings.mesh.points)} nodes; {_sizes(s)}"),
        ("solver", f"{case.solver.name}, {case.material.strain_measure} strain, "
                   f"time steps of an interval: {case.solver.steps_per_interval}"),
        ("images", f"{len(m['time'])} of {m['reference'].shape[0]} × {m['reference'].shape[1]} px, "
                   f"{1e3 * float(m['pixel']):g} nm a pixel, {m['rows'].size} px used{but}"),
        ("noise", f"height {number(1e3 * float(m['sigma']))} nm an image "
                  f"({'as stated' if stated else reference}), load "
                  f"{number(findings.load_noise)} µN; on the correlation mesh "
                  f"{number(findings.noise_factor)} times that "
                  f"{'stated' if stated else 'of the repeats'}"),
        *([("no repeats", _without_repeats(m))] if stated else []),
        ("test", f"{int(m['cycle'].max())} cycles, stage travel up to {m['stage'].max():g} µm, "
                 f"load up to {number(peak, 4)} µN"),
        *ends,
    ]  # fmt: skip


def _without_repeats(measured: Mapping[str, Any]) -> str:
    """Return what a stated noise costs, and whether the images contradict it."""
    chi_of_fitted = measured["chi"][measured["left_out"] == 0]
    told = contradiction(float(measured["sigma"]), float(measured["noise_later"]), chi_of_fitted)
    return f"{COST}. {told}" if told else COST


def _sizes(specimen: Specimen) -> str:
    """Return the sizes of both meshes, and how often chosen ones were refined."""
    sizes = f"sizes {specimen.mesh_size:g} and, of the finer mesh, {specimen.fine_mesh_size:g} µm"
    refined = specimen.refined
    if specimen.of_mesh:
        working, finer = map(specimen.divisions, (specimen.mesh_size, specimen.fine_mesh_size))
        return f"{sizes}, edges of {specimen.mesh_file} in {working} and {finer} pieces"
    if refined is None:
        return f"{sizes}, as stated"
    times = "once" if refined == 1 else f"{refined} times"
    return f"{sizes}, chosen by prismid and {f'refined {times}' if refined else 'not refined'}"
