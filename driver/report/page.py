"""The report page: what stands in it, and its rendering."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from driver.case.grains import Grain
from driver.case.specimen import Specimen
from driver.common.formatting import chi, joined, number, probability
from driver.diagnosis.answer.result_types import GATE, IMAGING
from driver.experiment.orientations import GrainOrientation, grain_orientations
from driver.experiment.reading import fitted_loads
from driver.parameters.registry import label_of
from driver.report.evidence_figures import signed_evidence
from driver.report.findings import Findings
from driver.report.identified_texts import identification, law_tiles
from driver.report.labels import cause_label
from driver.report.measured_texts import texts
from driver.report.references import REFERENCES
from driver.report.style import INDEXED, TONES, data_uri
from driver.report.tables import added_rows, cause_rows, localisation_rows, measure, parameter_rows
from templates import render

TEMPLATE = "report.html.j2"
Row = dict[str, Any]
_FEW = ("Law", "Added", "Apex amplitudes")  # groups of parameters that are shown at once

_CELLS = {10: "tetrahedra", 20: "hexahedra"}  # by their number of nodes


def report_page(
    findings: Findings,
    figures: Mapping[str, bytes],
    title: str,
    date: str,
    version: str,
    files: Mapping[str, str],
) -> str:
    """Return the page as HTML.

    Args:
        findings: the results.
        figures: PNG files by name; those of the rounds are "evidence_1", "evidence_2", …
        title: name of the case.
        date: when the report was written.
        version: version of prismid.
        files: what each result file holds, by name.
    """
    diagnosis = findings.diagnosis
    declared = findings.declared
    sentences = verdict_texts(diagnosis)
    if findings.extended:
        sentences.append(gain_text(diagnosis))
    places, phases = localisation_rows(diagnosis["whereabouts"])
    shifts = parameter_rows(findings) if findings.extended else []
    page = render(
        TEMPLATE,
        title=title,
        date=date,
        version=version,
        extended=findings.extended,
        kind=diagnosis["verdict"],
        tone=TONES[diagnosis["verdict"]],
        headline=sentences[0],
        paragraphs=sentences[1:],
        next=" ".join(filter(None, (diagnosis["next"], findings.advice))),
        added=added_rows(findings),
        law=law_tiles(findings),
        tiles=tiles(diagnosis),
        checks=checks(findings),
        facts=facts(findings),
        whereabouts=diagnosis["whereabouts"]["text"],
        places=places,
        phases=phases,
        measured=texts(findings.motion),
        untried=untried(findings),
        rounds=[
            {
                "number": index,
                "figure": f"evidence_{index}",
                "chi_load": chi(step["chi_load"]),
                "chi_image": chi(step["chi_image"]),
                "named": [cause_label(name) for name in step["named"]],
                "omnibus": _omnibus(step["omnibus"]),
                "accepted": step["omnibus"]["accepted"],
                "rows": cause_rows(step, declared),
            }
            for index, step in enumerate(diagnosis["steps"], start=1)
        ],
        identified=identification(findings),
        groups=[group for group in shifts if group[0] in _FEW],
        other_groups=[group for group in shifts if group[0] not in _FEW],
        figures={name: data_uri(image) for name, image in figures.items()},
        references=REFERENCES,
        files=files,
    )
    return INDEXED.sub(r"\1<sub>\2</sub>", page)


def verdict_texts(diagnosis: Row) -> list[str]:
    """Return the verdict in one sentence, and the paragraph below it."""
    summary = headline(diagnosis["verdict"], diagnosis["sets"])
    if diagnosis["verdict"] == "named":
        return [diagnosis["text"], summary]
    return [summary, diagnosis["text"]]


def gain_text(diagnosis: Row) -> str:
    """Return what the extension has gained, in words."""
    gain = diagnosis["gain"]
    before, after = gain["budget_before"], gain["budget_after"]
    added = joined(
        [
            f"{label_of(name)} = {measure(name, entry['unit'], entry['value'], entry['sigma'])}"
            for name, entry in diagnosis["added"].items()
        ]
        + [cause_label(name) for name in diagnosis["flips"]]
    )
    text = (
        f"With {added} the residual of the loads goes from χ_F = {chi(before['load'])} to "
        f"{chi(after['load'])}, that of the images from χ = {chi(before['basis'])} to "
        f"{chi(after['basis'])} (1 is noise)."
    )
    if "held_out" in gain:
        held = gain["held_out"]
        text += (
            f" Cycle {held['cycle']}, predicted from the other cycles and not fitted, goes from "
            f"χ_F = {chi(held['chi_load_before'])} to {chi(held['chi_load_after'])}."
        )
    return text


def headline(kind: str, sets: Sequence[Sequence[str]]) -> str:
    """Return the kind of a verdict as a sentence.

    Args:
        kind: the answer.
        sets: for each effect that it names the causes that cannot be told apart.
    """
    names = ", and ".join(_one_of(group) for group in sets)
    several = len(sets) > 1
    either = joined([cause_label(name) for name in sets[0]]) if sets else ""
    sentences = {
        "nothing wrong": "Nothing wrong: the model leaves only noise.",
        "named": f"{'Together these causes explain' if several else 'One cause explains'} "
        f"the misfit: {names}.",
        "one of this set": f"Together these explain the misfit: {names}."
        if several
        else f"One of these explains the misfit, and these data cannot say which: {either}.",
        "named, but something is left": f"Found: {names}; but something is left that is not noise.",
        "unexplained": "Unexplained: the model misses something that no cause that was tried "
        "accounts for.",
        "imaging-limited": "The images are the limit: their errors outweigh those of the model.",
        "numerics": "The simulation is not exact enough to judge the model.",
    }
    return sentences[kind]


def tiles(diagnosis: Row) -> list[Row]:
    """Return the figures that a reader looks for first."""
    gain, added = diagnosis["gain"], bool(diagnosis["added"] or diagnosis["flips"])
    before, after = gain["budget_before"], gain["budget_after"]
    rows = []
    if added:
        share = gain["share_of_excess_explained"]
        rows += [
            _tile(
                "log Bayes factor", signed_evidence(gain["log_bayes_factor"]),
                "of the extended model against the identified one",
            ),
            _tile(
                "excess explained", "–" if share is None else f"{number(100.0 * share)} %",
                "share of the misfit above noise that is gone",
            ),
        ]  # fmt: skip
    if "held_out" in gain:
        held = gain["held_out"]
        load = held["chi_load_before"], held["chi_load_after"]
        image = held["chi_image_before"], held["chi_image_after"]
        rows.append(
            _tile(f"held-out cycle {held['cycle']}: χ_F", _change(load, added),
                  f"predicted, not fitted; images: χ {_change(image, added)}")
        )  # fmt: skip
    rows += [
        _tile("loads: χ_F", _change((before["load"], after["load"]), added),
              "1 where no more is left than noise and the error of the mesh"),
        _tile("images: χ", _change((before["basis"], after["basis"]), added),
              "on the correlation mesh, 1 where only noise is left"),
    ]  # fmt: skip
    return rows


def checks(findings: Findings) -> list[Row]:
    """Return what had to hold for the verdict to be trusted, and whether it did."""
    diagnosis = findings.diagnosis
    discretisation_check, last = diagnosis["numerics"], diagnosis["steps"][-1]["omnibus"]
    free = diagnosis["gain"]["budget_before"]["free"]
    effect = number(discretisation_check["effect_sigma"], 2)
    rows = [
        {
            "what": "mesh and time steps",
            "passed": discretisation_check["passed"],
            "text": f"their error changes by {effect} σ from the identified to the extended model "
            f"(at most {GATE:g} σ is tolerated)",
        },
        {
            "what": "images",
            "passed": free <= IMAGING,
            "text": f"free correlation leaves χ = {chi(free)}",
        },
        {
            "what": "what is left",
            "passed": last["accepted"],
            "text": f"{_omnibus(last)} (rejected below a family-wise 1 %)",
        },
    ]
    for name, key in (("identified model", "baseline"), ("extended model", "extended")):
        if key == "baseline" or findings.extended:
            end = diagnosis[key]
            rows.append({"what": f"fit of the {name}", "passed": end["converged"],
                         "text": f"ended: {end['reason']}"})  # fmt: skip
    return rows


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
    left = [str(frame) for frame, out in enumerate(m["left_out"]) if out]
    fate = "is unlike its" if len(left) == 1 else "are unlike their"
    but = f"; {joined(left)} {fate} neighbours and not fitted but for the load" if left else ""
    return [
        ("prism", f"{s.length:g} × {s.width:g} × {s.depth:.3g} µm (Y, X, Z), "
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
                  f"(reference: mean of {float(m['n_reference']):g}), load "
                  f"{number(findings.load_noise)} µN; on the correlation mesh "
                  f"{number(findings.noise_factor)} times that of the repeats"),
        ("test", f"{int(m['cycle'].max())} cycles, stage travel up to {m['stage'].max():g} µm, "
                 f"load up to {number(peak, 4)} µN"),
    ]  # fmt: skip


def _sizes(specimen: Specimen) -> str:
    """Return the sizes of both meshes, and how often chosen ones were refined."""
    sizes = f"sizes {specimen.mesh_size:g} and, of the finer mesh, {specimen.fine_mesh_size:g} µm"
    refined = specimen.refined
    if refined is None:
        return f"{sizes}, as stated"
    times = "once" if refined == 1 else f"{refined} times"
    return f"{sizes}, chosen by prismid and {f'refined {times}' if refined else 'not refined'}"


def _one_of(group: Sequence[str]) -> str:
    labels = joined([cause_label(name) for name in group])
    return labels if len(group) == 1 else f"one of {labels} (these data cannot say which)"


def _tile(title: str, value: str, note: str) -> Row:
    return {"title": title, "value": value, "note": note}


def _change(pair: tuple[float, float], changed: bool) -> str:
    before, after = (chi(value) for value in pair)
    return f"{before} → {after}" if changed else before


def _omnibus(tests: Row) -> str:
    return (
        f"slow part of the load p = {probability(tests['load_slow_p'])}, "
        f"its serial correlation p = {probability(tests['load_serial_p'])}, "
        f"slow part of the images p = {probability(tests['image_slow_p'])}, "
        f"single images p = {probability(tests['image_outlier_p'])}, "
        f"all causes together p = {probability(tests['together_p'])}, "
        f"smooth motions that grow with the stretch p = {probability(tests['smooth_p'])}"
    )
