import base64
import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from driver.case.grains import Grain
from driver.case.model import load_case, write_case
from driver.case.specimen import Specimen
from driver.diagnosis.causes.causes import LIBRARY
from driver.diagnosis.causes.ebsd_flips import FLIPS
from driver.report.all_figures import draw
from driver.report.findings import FILES, Record, read_findings
from driver.report.first_screen import first_screen_identified
from driver.report.labels import cause_label
from driver.report.measured import MeasuredMotion
from driver.report.measured_texts import texts
from driver.report.page import facts, report_page
from driver.report.tables import cause_rows
from driver.report.verdict import checks, first_screen, gain_text, headline, smallest_lead
from driver.report.view import view_of_findings
from driver.results.files import AbsentError
from driver.results.hdf5 import ResultError
from driver.workflow.report_stage import run_report, run_report_identified
from meshes.arrays import FloatArray
from tests.driver.ebsd_files import grid, write_ctf
from tests.driver.invented_results import Results

FIGURES = (
    "budget", "specimen", "loading_axes", "slip", "motion", "fields", "loads", "residual_maps",
    "residual_over_strain", "residual_history", "evidence_1", "evidence_2", "critical_stress",
    "sensitivity",
    "correlation", "convergence",
)  # fmt: skip
MEASURED = (
    "measure_reference", "measure_fields", "measure_travel", "measure_grip",
    "measure_residuals", "measure_noise",
)  # fmt: skip
KINDS = (
    "nothing wrong", "named", "one of this set", "named, but something is left", "unexplained",
    "imaging-limited", "numerics",
)  # fmt: skip


@pytest.fixture(scope="module")
def made(written: Results, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with the report of the invented case."""
    folder = tmp_path_factory.mktemp("report")
    run_report(written.context(folder))
    return folder


@pytest.fixture(scope="module")
def page(made: Path) -> str:
    return (made / "report.html").read_text("utf-8")


def shown(page: str) -> str:
    """What a reader sees, without tags."""
    body = page.split("</style>")[1].split('<script type="application/json"')[0]
    body = body.replace("<sub>", "_").replace("</sub>", "")
    return re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", body))


def test_the_page_holds_all_that_it_shows(page: str) -> None:
    assert not re.findall(r"https?://|<script[^>]* src|<link|@import|url\(", page)
    sources = re.findall(r'src="([^"]*)"', page)
    assert len(sources) == len(FIGURES) + len(MEASURED)
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    targets = re.findall(r'href="([^"]*)"', page)
    assert all(target[0] == "#" and f'id="{target[1:]}"' in page for target in targets)


def test_every_figure_stands_in_the_page_and_beside_it(made: Path, page: str) -> None:
    assert (made / "report.html").stat().st_size < 8e6
    assert {path.name for path in made.iterdir()} == {
        "report.html", "report_parameters.csv", *(f"report_{name}.png" for name in FIGURES)
    }  # fmt: skip
    for name in FIGURES:
        image = (made / f"report_{name}.png").read_bytes()
        assert image.startswith(b"\x89PNG")
        assert base64.b64encode(image).decode() in page


def test_the_pictures_of_free_correlation_stand_in_the_page_with_words_for_each(
    written: Results, measured: MeasuredMotion, page: str
) -> None:
    assert tuple(texts(measured)) == MEASURED
    section = page[page.index('id="measured"') : page.index('id="specimen"')]
    for name, text in texts(measured).items():
        image = base64.b64encode((written.results / f"{name}.png").read_bytes()).decode()
        assert f'<img src="data:image/png;base64,{image}" alt="{text.alternative}">' in section
        assert text.caption in section


def test_the_critical_stress_along_the_grains_is_told_and_shown_where_it_varies(
    made: Path, page: str
) -> None:
    section = page[page.index('id="stress"') : page.index('id="parameters"')]
    told = "The band in grain 2 has 0.70 ± 0.04 times the critical stress."
    assert told in section and page.index(told) < page.index("Face and loads")
    image = (made / "report_critical_stress.png").read_bytes()
    assert base64.b64encode(image).decode() in section


def test_the_verdict_and_the_gain_come_first(page: str) -> None:
    text = shown(page)
    words = (
        "invented", "Verdict: named",
        "The two grains have different critical resolved shear stresses.",
        "1.149 ± 0.004", "ahead of the next cause +260", "cycle 2: χ_F of loads 5.31 → 1.07",
        "12.3 → 5.1 σ", "What to do next. Confirm grain contrast: nano-indentation of both grains.",
        "All 5 checks are passed", "One cause explains the misfit: grain contrast.",
        "98.7 % of the misfit above noise is gone",
        "χ = 1.60 → 1.03, the loads χ_F = 6.70 → 0.98, where noise alone makes 1", "Error budget",
    )  # fmt: skip
    places = [text.index(word) for word in words]
    assert places == sorted(places)
    assert "σ away; either of two finer meshes alone would put it off by 0.0072" in text


def test_a_local_misfit_is_not_told_by_averages_that_hardly_move(results: Results) -> None:
    gain = json.loads((results.results / "diagnosis.json").read_text("utf-8"))["gain"]
    gain["budget_before"] |= {"basis": 1.04, "load": 1.01}
    results.edit_diagnosis(gain=gain)
    text = gain_text(results.findings().diagnosis)
    assert text.index("12.3 σ beyond noise become 5.1 σ") < text.index("So local a misfit hardly")
    assert "loads χ_F = 1.01 → 0.98, where noise alone makes 1" in text


def test_the_lead_of_a_cause_is_that_of_the_round_that_decides_least() -> None:
    def cause(name: str, screened: float, refitted: float | None = None) -> Record:
        refit = None if refitted is None else {"log_evidence": refitted}
        return {"cause": name, "log_evidence": screened, "refit": refit}

    first = [cause("a", 90.0, 100.0), cause("b", 99.0, 95.0), cause("c", 98.0, 99.0)]
    second = [cause("b", 5.0, 30.0), cause("d", 20.0)]
    steps: list[Record] = [
        {"named": ["a", "b"], "left_something": ["c"], "causes": [*first, cause("d", 50.0)]},
        {"named": ["b"], "left_something": [], "causes": second},
        {"named": [], "left_something": [], "causes": second},
    ]
    lead = smallest_lead(steps)
    assert lead is not None and (lead.cause, lead.next, lead.ahead) == (("b",), "d", 10.0)
    assert smallest_lead(steps[2:]) is None


def test_parameters_of_the_final_model_stand_in_a_table_beside_those_before(made: Path) -> None:
    with (made / "report_parameters.csv").open(newline="") as file:
        rows = {row["parameter"]: row for row in csv.DictReader(file)}
    assert rows["tau0_grain2"] == {
        "parameter": "tau0_grain2", "value": "1.1493", "sigma": "0.0041", "unit": "",
        "value_before": "", "sigma_before": "", "model": "extended",
    }  # fmt: skip
    assert (rows["tau0"]["value"], rows["tau0"]["value_before"]) == ("21.34", "21.34")


def test_the_systems_that_slipped_most_stand_with_schmid_factor_and_share(page: str) -> None:
    text = shown(page)
    part = text[text.index("Slip and orientations") :]
    # The last system of grain 1 slips by 24 of 300 per mille.
    assert "(1 1 −2) [1 1 1]" in part and "2.40 % 8 %" in part
    assert "by the extended model" in part


def test_what_the_final_model_has_far_off_its_prior_and_the_motion_of_its_ends_are_shown(
    page: str,
) -> None:
    text = shown(page)
    assert "To be looked at: far off the prior, in widths of it: d by +3.4." in text
    assert "motion of the ends" in text and "the elongation is (5.10 ± 0.05)·10⁻⁴" in text


def test_each_residual_of_one_model_is_told_with_what_it_is_over(page: str) -> None:
    text = shown(page)
    assert "The identification ended at χ_F = 6.90; the diagnosis" in text
    assert "begins with the same model at 6.70. Over γ_F alone" in text and "at 58.0." in text


def test_without_a_diagnosis_the_identified_model_is_shown_and_what_was_not_done(
    results: Results, tmp_path: Path, lines: list[str]
) -> None:
    for name in ("diagnosis.json", "diagnosis.h5", "advice.json"):
        (results.results / name).unlink()
    run_report_identified(results.context(tmp_path / "work"))
    page = (tmp_path / "work" / "report.html").read_text("utf-8")
    text = shown(page)
    assert "The law is identified; whether the model is right has not been examined." in text
    assert "images: χ 1.62" in text and "loads: χ_F 6.90" in text
    assert "goes on with the diagnosis" in text and "Evidence of every cause" not in text
    assert "Not passed: misfit of the identified model" in text
    assert "images χ = 1.62, loads χ_F = 6.90" in text
    assert "identified model" in text and "report_evidence_1.png" not in page
    assert any("not diagnosed. identified model: τ₀ = 21.34 ± 0.12 MPa" in line for line in lines)


@pytest.mark.parametrize("far", [False, True])
def test_a_parameter_far_off_its_prior_is_a_check_that_is_not_passed(
    written: Results, far: bool
) -> None:
    told = "far off the prior, in widths of it: origin_X by −12.2; usually the model lacks …"
    other = "λ⁺_Z: the data hardly see it; 63% of its variance is that of its prior"
    findings = replace(written.findings(), warnings=(other, told) if far else (other,))
    head = first_screen_identified(findings, "the Newton decrement is 0.04 σ", True)
    (row,) = [check for check in head.checks if check["what"] == "priors"]
    assert row["passed"] != far and ("origin_X" in row["text"]) == far


@pytest.mark.parametrize(
    ("times", "told"),
    [
        (0, "to the extended model (at most"),
        (1, "to the extended model, fitted anew with it 1 time before (at most"),
        (2, "to the extended model, fitted anew with it 2 times before (at most"),
    ],
)
def test_a_model_that_was_fitted_with_its_own_correction_says_so(
    written: Results, times: int, told: str
) -> None:
    findings = written.findings()
    assert findings.diagnosis is not None
    numerics = findings.diagnosis["numerics"] | {"fitted_anew": times}
    row, *_ = checks(replace(findings, diagnosis=findings.diagnosis | {"numerics": numerics}))
    assert row["what"] == "mesh and time steps" and told in row["text"]


def test_what_two_finer_meshes_differ_by_is_told_as_that(written: Results) -> None:
    findings = written.findings()
    assert findings.diagnosis is not None
    between = {"between_meshes": True, "passed": False, "effect_sigma": 5.0, "on": "load_drift"}
    numerics = findings.diagnosis["numerics"] | between
    row, *_ = checks(replace(findings, diagnosis=findings.diagnosis | {"numerics": numerics}))
    text = "two finer meshes differ by 5.0 σ along load drift (at most 4 σ is tolerated)"
    assert row["text"] == text and not row["passed"]


def test_the_second_finer_mesh_that_judges_is_told(written: Results) -> None:
    findings = written.findings()
    assert findings.diagnosis is not None
    numerics = findings.diagnosis["numerics"] | {"second_mesh_um": 2 / 3}
    row, *_ = checks(replace(findings, diagnosis=findings.diagnosis | {"numerics": numerics}))
    assert row["text"].endswith("; their correction is that of a second finer mesh, of 0.667 µm")


def test_names_of_the_case_break_out_of_neither_page_nor_script(written: Results) -> None:
    name, findings = "</script><b onclick=x>'\"&amp;", written.findings()
    grains = (findings.case.grains[0].model_copy(update={"name": name}), *findings.case.grains[1:])
    findings = replace(findings, case=findings.case.model_copy(update={"grains": grains}))
    pictures = dict.fromkeys((*FIGURES, *MEASURED), b"")
    page = report_page(
        findings, first_screen(findings), view_of_findings(findings), pictures, f"a{name}", "", "",
        {},
    )  # fmt: skip
    assert "<b onclick" not in page
    whole = page.split('id="settings">')[1].split("</script>")[0]
    assert json.loads(whole)["grains"][0]["name"] == name


def test_the_sizes_of_the_meshes_and_their_refinements_are_told(written: Results) -> None:
    findings = read_findings(load_case(written.folder / "case.toml"), written.results)

    def mesh(specimen: Specimen) -> str:
        case = findings.case.model_copy(update={"specimen": specimen})
        return dict(facts(replace(findings, case=case)))["mesh"]

    stated = findings.case.specimen
    assert mesh(stated).endswith("sizes 2 and, of the finer mesh, 1 µm, as stated")
    chosen = [mesh(stated.at_level("hex20", level)) for level in range(3)]
    assert chosen[0].endswith(
        "sizes 2 and, of the finer mesh, 1 µm, chosen by prismid and not refined"
    )
    assert chosen[1].endswith("0.667 µm, chosen by prismid and refined once")
    assert chosen[2].endswith("0.5 µm, chosen by prismid and refined 2 times")


def test_a_stated_noise_is_told_with_its_cost_and_what_contradicts_it(written: Results) -> None:
    findings = read_findings(load_case(written.folder / "case.toml"), written.results)
    assert "no repeats" not in dict(facts(findings))
    case = findings.case.with_values_at({"images.repeats": None})
    for sigma, contradicts in ((0.009, False), (0.003, True)):
        measured = dict(findings.measured) | {"sigma": np.array(sigma)}
        told = dict(facts(replace(findings, case=case, measured=measured)))
        assert "as stated" in told["noise"] and "image 0 is the reference" in told["no repeats"]
        assert ("images.noise_nm: found 3" in told["no repeats"]) == contradicts


def test_orientations_are_told_with_where_they_are_from(written: Results) -> None:
    findings = read_findings(load_case(written.folder / "case.toml"), written.results)
    stated = dict(facts(findings))["grains (Bunge angles)"]
    assert stated == "grain 1 (0°, 0°, 0°); grain 2 (30°, 0°, 0°)"
    x, y = grid(3, 4)
    write_ctf(written.folder / "a.ctf", x, y, (30.0, 20.0, 10.0))
    grain = Grain(name="mapped", ebsd="a.ctf", ebsd_point_um=(0.0, 0.0))
    case = findings.case.model_copy(update={"grains": (grain, findings.case.grains[1])})
    told = dict(facts(replace(findings, case=case)))["grains (Bunge angles)"]
    assert told.startswith("mapped (30.00°, 20.00°, 10.00°, mean of 12 points of a.ctf that spread")


def test_every_cause_stands_in_the_table_with_its_sentence(page: str) -> None:
    text = shown(page)
    for cause in LIBRARY:
        assert cause_label(cause.name) in text
        assert f"{cause.category}: {cause.sentence}".replace("'", "&#39;") in text
    assert "grain contrast (added)" in text and "{112} family (not told from it)" in text
    assert "load drift over the test +0.140 µN not visible" in text


def test_identified_parameters_are_written_with_interval_prior_and_its_share(page: str) -> None:
    text = shown(page)
    assert "τ₀ tau0 MPa 40.00 5.6 to 280 21.34 ± 0.12 21.11 to 21.58 &lt; 1 %" in text
    assert "c c GPa 40.00 5.6 to 280 44.1 ± 0.4 43.4 to 44.8 &lt; 1 %" in text
    assert "d d 1 1500 1500 to 1500 1140 ± 13 1115 to 1166 83 %" in text
    assert "To be looked at: d: the data hardly see it." in text
    assert "To be looked at: λ⁺_Y stands at 5." in text
    assert "ΔU_Y, knot 1 elongation_1 nm 0 none 30.00 ± 0.20 29.61 to 30.39 –" in text
    assert "Strongest: c and d (−0.93)." in text


def test_what_the_extension_changed_is_told(page: str) -> None:
    text = shown(page)
    assert "τ₀ tau0 MPa 40.00 21.34 ± 0.12 21.11 to 21.58 21.34 ± 0.12 0" in text
    assert "ΔU_Y, knot 1 elongation_1 nm 0 30.00 ± 0.20 29.61 to 30.39 30.00 ± 0.20 0" in text
    assert "tau0_grain2 1.000 1.149 ± 0.004 1.141 to 1.157 – –" in text
    assert text.index("1.141 to 1.157") < text.index("which the diagnosis rejects")


def test_the_law_stands_beside_the_verdict_with_its_intervals(page: str) -> None:
    text = shown(page)
    top = text[: text.index("Face and loads")]
    assert "τ₀ 21.34 ± 0.12 MPa 95 %: 21.11 to 21.58; before the extension 21.34 ± 0.12" in top
    assert "c 44.1 ± 0.4 GPa" in top and "λ" not in top


def test_residuals_and_parameters_stand_in_the_form_of_the_literature(page: str) -> None:
    text = shown(page)
    assert "χ_f λ⁺_Y λ⁺_Z λ⁻_Y λ⁻_Z free correlation (DIC) 0.70 – – – – start 4.46 1.00" in text
    assert "identified 4.47 0.970 ± 0.021" in text
    assert (
        "χ χ_f χ_F over γ_F alone τ₀ [MPa] c [GPa] d start 4.64 4.46 78.0 40.00 40.00 1500" in text
    )
    assert "identified 4.52 4.47 58.0 21.34 ± 0.12 44.1 ± 0.4 1140 ± 13" in text
    # noise alone: √((1 + 1/10)/2) with ten images in the reference
    assert "noise alone leaves χ_f = 0.74 here" in text


def test_the_budget_stands_in_numbers_under_its_bars(page: str) -> None:
    text = shown(page)
    assert "noise alone 1.00 0.74 1.00 1.00 free correlation (DIC) 1.01 0.70 – –" in text
    assert "model before 1.31 4.47 1.60 6.70 extended model 1.02 – 1.03 0.98" in text


def test_the_time_is_told_by_stage(page: str) -> None:
    text = shown(page)
    assert "mesh 0.5 s &lt; 1 % measure 9.5 s 10 % identify A 20 s 20 %" in text
    assert "identify, the rest 30 s 30 % all 1.7 min 100 %" in text


def test_every_figure_has_words_for_those_who_do_not_see_it(page: str) -> None:
    alternatives = re.findall(r'<img src="[^"]*" alt="([^"]*)"', page)
    assert len(alternatives) == len(FIGURES) + len(MEASURED)
    assert all(len(words) > 15 and "<" not in words for words in alternatives)


def test_only_files_that_are_there_are_listed(page: str) -> None:
    assert "diagnosis.json" in page and "mesh_fine.med" in FILES
    assert "mesh_fine.med" not in page


def test_where_and_when_the_models_miss_the_data_is_a_table(
    results: Results, tmp_path: Path
) -> None:
    run_report(results.context(tmp_path / "work"))
    page = (tmp_path / "work" / "report.html").read_text("utf-8")
    assert "The identified model misses what the images show most at grain 2." in shown(page)
    assert "σ beyond noise grain 2 loads unloading 12.3 → 5.1 0.4 → 0.0" in shown(page)
    assert "<b>12.3</b> → <b>5.1</b>" in page and "0.4 → 0.0" in page and "<b>0.4" not in page


def test_without_an_addition_one_model_is_shown(results: Results, tmp_path: Path) -> None:
    diagnosis = json.loads((results.results / "diagnosis.json").read_text("utf-8"))
    gain = diagnosis["gain"] | {"share_of_excess_explained": None, "log_bayes_factor": 0.0}
    gain.pop("held_out")
    where = diagnosis["whereabouts"] | {"after": []}
    results.edit_diagnosis(
        verdict="nothing wrong", causes=[], sets=[], added={}, gain=gain, whereabouts=where,
        steps=diagnosis["steps"][1:], extended=diagnosis["baseline"],
        text="What is left is noise.", next="Read the table.",
    )  # fmt: skip
    run_report(results.context(tmp_path / "work"))
    text = shown((tmp_path / "work" / "report.html").read_text("utf-8"))
    assert text.index("Nothing wrong: the model leaves only noise.") < text.index("What is left is")
    assert "All free parameters together, from images and loads" in text
    assert "ahead of" not in text and "→" not in text and "the extension" not in text


@pytest.mark.parametrize("kind", KINDS)
def test_every_verdict_is_said_in_one_sentence(kind: str) -> None:
    sentence = headline(kind, [["load_gain", "section_depth"]])
    assert sentence.endswith(".") and "\n" not in sentence
    if kind.startswith(("named", "one of")):
        assert "load gain and depth of the section" in sentence


@pytest.mark.parametrize("kind", ["named", "one of this set"])
def test_no_cause_explains_a_misfit_that_is_not_there_or_that_stays(kind: str) -> None:
    sets = [["load_gain"]] if kind == "named" else [["load_gain", "section_depth"]]
    for share, told in (
        (None, "too small or too local for the averages"),
        (0.31, "takes 31 % of the misfit above noise"),
    ):
        sentence = headline(kind, sets, share)
        assert "explain" not in sentence
        assert sentence.startswith("Found: ") and told in sentence
    assert "explains the misfit" in headline(kind, sets, 0.97)


def test_a_cause_that_is_sure_is_not_said_to_be_one_of_a_set_beside_it() -> None:
    sentence = headline("one of this set", [["load_lag"], ["load_gain", "section_depth"]])
    assert sentence == (
        "Together these explain the misfit: load lag, and one of load gain and depth of the "
        "section (these data cannot say which)."
    )


@pytest.mark.parametrize(
    "name",
    ["mesh.med", "measure.h5", "measure_fields.png", "identify.h5", "diagnosis.json",
     "diagnosis.h5"],
)  # fmt: skip
def test_a_missing_result_is_named_in_one_sentence(
    results: Results, tmp_path: Path, name: str
) -> None:
    (results.results / name).unlink()
    with pytest.raises(AbsentError, match=rf"{name}: found nothing, expected the result of"):
        run_report(results.context(tmp_path / "work"))


def test_results_of_another_version_are_refused_with_what_to_do(
    results: Results, tmp_path: Path
) -> None:
    with h5py.File(results.results / "diagnosis.h5", "a") as file:
        del file["after/rho"]
    with pytest.raises(ResultError, match="found no dataset after/rho.*the stage diagnose alone"):
        run_report(results.context(tmp_path / "work"))


@pytest.mark.parametrize(
    "missing",
    [
        "together_p",
        "smooth_p",
        "left_something",
        "corrected",
        "off_by_mesh",
        "between_meshes",
        "fitted_anew",
        "missing_share",
        "second_mesh_um",
    ],
)
def test_a_verdict_of_an_earlier_version_is_refused_with_what_to_do(
    missing: str, results: Results, tmp_path: Path
) -> None:
    found = json.loads((results.results / "diagnosis.json").read_text("utf-8"))
    steps, numerics = found["steps"], found["numerics"]
    refits = [one["refit"] for step in steps for one in step["causes"] if one["refit"]]
    for entries in (steps[1], steps[1]["omnibus"], numerics, *refits):
        entries.pop(missing, None)
    results.edit_diagnosis(steps=steps, numerics=numerics)
    with pytest.raises(ResultError, match=f"found no entry {missing}.*the stage diagnose alone"):
        run_report(results.context(tmp_path / "work"))


def test_refits_that_were_corrected_less_are_outlined_in_the_figure_of_their_round(
    results: Results,
) -> None:
    steps = json.loads((results.results / "diagnosis.json").read_text("utf-8"))["steps"]
    first = steps[0]
    less = [one for one in first["causes"] if one["refit"] and one["cause"] != first["named"][0]]
    for one in less:
        one["refit"]["corrected"] = "at the baseline"
    results.edit_diagnosis(steps=steps)
    figure = dict(draw(results.findings()))["evidence_1"]
    outlined = [bar for bar in figure.axes[0].patches if not bar.get_fill()]
    assert len(outlined) == len(less) > 0


def test_what_was_not_examined_and_the_loads_left_out_stand_beside_the_evidence(
    page: str, results: Results, tmp_path: Path
) -> None:
    text = shown(page)
    assert "Not examined: fixed pattern; no flats show the pattern." in text
    turns = "EBSD frame turned by half a turn about"
    assert f"Not examined: {turns} X and {turns} Y; nothing calls for it." in text
    assert "The load of image 4 is left out: it is off by 61.0 µN, 9.8 of its" in text
    assert "only the causes that the case asks for" not in text
    case = results.folder / "case.toml"
    asked = case.read_text("utf-8").replace('causes = "all"', 'causes = ["grain_contrast"]')
    case.write_text(asked.replace("left_out = []", "left_out = [9, 2]"), "utf-8")
    run_report(results.context(tmp_path / "work"))
    text = shown((tmp_path / "work" / "report.html").read_text("utf-8"))
    assert "The case leaves out the loads of images 2 and 9." in text
    assert "Of the library only the causes that the case asks for were tried." in text


def test_a_parameter_that_the_identification_did_not_have_was_at_its_null(
    results: Results, tmp_path: Path
) -> None:
    """That of a term of the user's own, installed between identification and diagnosis."""
    with h5py.File(results.results / "identify.h5", "a") as file:
        values = json.loads(file.attrs["all_values"])
        del values["tau0_grain2"]
        file.attrs["all_values"] = json.dumps(values)
    assert results.findings().values["tau0_grain2"] == 1.0


def test_a_damaged_verdict_is_named_in_one_sentence(results: Results, tmp_path: Path) -> None:
    (results.results / "diagnosis.json").write_text("{", "utf-8")
    with pytest.raises(ResultError, match=r"diagnosis.json: found no readable JSON"):
        run_report(results.context(tmp_path / "work"))


def test_the_residual_of_pure_noise_is_one_wherever_the_stage_has_moved(
    results: Results, tmp_path: Path
) -> None:
    rng = np.random.default_rng(0)
    with h5py.File(results.results / "measure.h5", "a") as file:
        motion = np.zeros(file["motion"].shape)
        motion[1::2] = [0.5 * 0.11, 0.5 * 0.11, 0.0]  # between pixels, noise is averaged
        file["motion"][...] = motion
    # At half a pixel the cubic spline passes this share of the variance of white noise.
    gain = np.where(np.arange(len(motion)) % 2, spline_gain() ** 2, 1.0)
    with h5py.File(results.results / "diagnosis.h5", "a") as file:
        noise = rng.standard_normal(file["before/rho"].shape)
        file["before/rho"][...] = 0.009 * np.sqrt(gain + 0.1)[:, None] * noise
    residual = results.findings().residual("before")
    rms = np.sqrt(np.mean(residual**2, axis=1))
    assert rms == pytest.approx(np.ones(len(rms)), abs=0.04)


def spline_gain() -> float:
    """Σ h² of the interpolating cubic spline at half a pixel, along one axis.

    h is its cardinal function, from the B-spline filter 1/(2/3 + 1/3 cos ω) on the samples.
    """
    n = 512
    omega = 2 * np.pi * np.fft.fftfreq(n)
    half = (46 * np.cos(omega / 2) + 2 * np.cos(1.5 * omega)) / 48
    return float(np.mean((half / (2 / 3 + np.cos(omega) / 3)) ** 2))


def test_the_identified_motion_passes_through_its_knots(written: Results, tmp_path: Path) -> None:
    findings = written.findings()
    at_knots = findings.edges("before")[findings.history.turning]
    assert at_knots[:, 0] == pytest.approx([0.0, 0.030, 0.018, 0.060, 0.042])
    assert at_knots[:, 1] == pytest.approx(np.zeros(5))
    assert findings.peaks.tolist() == [3, 8]


def test_a_frame_that_is_left_out_is_named(page: str) -> None:
    assert "; 7 is unlike its neighbours and not fitted but for the load" in page


def test_with_the_knots_held_the_page_shows_the_law_and_how_the_amplitudes_were_found(
    results: Results, tmp_path: Path
) -> None:
    """In the paper's order only the law is free at the end, and only the amplitudes in stage A."""
    with h5py.File(results.results / "identify.h5", "a") as file:
        names = json.loads(file.attrs["names"])
        rows = [names.index(name) for name in ("tau0", "c", "d")]
        file.attrs["names"] = json.dumps(["tau0", "c", "d"])
        file.attrs["units"] = json.dumps(["MPa", "MPa", ""])
        for name in ("start", "values", "prior/mean", "prior/width", "prior_share"):
            replaced(file, name, file[name][...][rows])
        for name in ("covariance", "correlation"):
            replaced(file, name, file[name][...][np.ix_(rows, rows)])
    path = results.results / "identify_history.json"
    stages = json.loads(path.read_text("utf-8"))
    for stage, fit in stages.items():
        for record in fit["iterations"]:
            for name in list(record):
                free = name.startswith("lambda") if stage == "A" else name in ("tau0", "c", "d")
                if not free and "chi" not in name:
                    del record[name]
    path.write_text(json.dumps(stages), "utf-8")
    run_report(results.context(tmp_path / "work"))
    text = shown((tmp_path / "work" / "report.html").read_text("utf-8"))
    assert "identified 4.47 0.9700 0.9700 0.9700 0.9700" in text
    assert "Knots of the boundary motion" not in text
    assert "τ₀ tau0 MPa 40.00 5.6 to 280 21.34 ± 0.12" in text


def replaced(file: h5py.File, name: str, values: FloatArray) -> None:
    del file[name]
    file[name] = values


def test_parameters_are_scaled_at_the_constants_of_the_case(
    results: Results, tmp_path: Path
) -> None:
    """A back strain saturates at 1/d: the standard deviation of x₀ is told in tenths of it."""
    path = results.folder / "case.toml"
    case = load_case(path)
    material = case.material.model_copy(update={"d": 2.0 * case.material.d})
    write_case(case.model_copy(update={"material": material}), path)
    declared = results.findings().declared
    assert declared["x0"].scale == pytest.approx(0.1 / material.d)


def test_a_flip_of_the_ebsd_frame_is_shown_without_a_parameter() -> None:
    flip = FLIPS[0]
    refit = {"log_evidence": 40.0, "chi_load": 1.0, "chi_image": 1.0, "values": {}, "sigma": {}}
    cause = {
        "cause": flip.name, "category": flip.category, "sentence": flip.sentence,
        "parameters": [], "units": [], "statistic": 90.0, "degrees": 0, "p_family": None,
        "log_evidence": 41.0, "estimate": [], "smallest_visible": [], "refit": refit,
    }  # fmt: skip
    (row,) = cause_rows({"named": [flip.name], "left_something": [], "causes": [cause]}, {})
    assert row["winner"] and row["refit"] == "+40.0" and row["p"] == "–"
    assert [parameter["label"] for parameter in row["parameters"]] == ["–"]
    gain = {
        "budget_before": {"load": 5.0, "basis": 2.0}, "budget_after": {"load": 1.0, "basis": 1.0},
        "share_of_excess_explained": 0.9,
    }  # fmt: skip
    where: Record = {"before": [], "after": []}
    text = gain_text({"gain": gain, "added": {}, "flips": [flip.name], "whereabouts": where})
    assert text.startswith("With EBSD frame turned by half a turn about X, 90.0 % of the misfit")
