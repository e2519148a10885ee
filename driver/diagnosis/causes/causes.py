"""The library of causes: each names parameters of the general model and says a sentence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from driver.parameters.covariance import DISCRETISATION
from solver_adapters.material import TAU0_BANDS, TAU0_MODES

Category = Literal["material", "microstructure", "boundary", "instrument", "numerics"]


@dataclass(frozen=True)
class Cause:
    """A possible reason of a model error.

    Attributes:
        name: unique name.
        category: which kind of people would mend it.
        parameters: the parameters that leave their null, one or more (none for a flip).
        companions: parameters that exist only under the alternative and are freed in the refit.
        one_sided: whether the (single) parameter can only be above its null.
        unseen: why the data leave no trace of it, where they leave none.
        sentence: what a person would say.
        label: as it is written in tables and figures; empty where the words of the name are.
        check: the physical check that would confirm it.
        odds: prior odds against the baseline, over those of the other causes.
        strongly_nonlinear: whether the (single) parameter does something else to the data far
            from its null than near it, so that it is looked at from afar as well where something
            is wrong (`finite_step_score`).
        check_always: whether it is looked at from afar also where nothing seems wrong: of a few
            prior scales neither the tests nor the scores of other causes see anything, or the
            derivative misleads (`kinked`).
        places: where it is looked for, as values of its first companion: it lies somewhere, and its
            derivative is that of one place. It is looked at in each where something is wrong.
        kinked: whether its effect has a kink at its null, so that the derivative there is that of
            neither side: it is looked at from beside the null as well.
    """

    name: str
    category: Category
    parameters: tuple[str, ...]
    sentence: str
    check: str
    companions: tuple[str, ...] = ()
    one_sided: bool = False
    unseen: str = "it does nothing to the data that the fitted parameters do not do"
    odds: float = 1.0
    strongly_nonlinear: bool = False
    check_always: bool = False
    places: tuple[float, ...] = ()
    kinked: bool = False
    label: str = ""

    @property
    def title(self) -> str:
        """The cause as it is written in tables, figures and text."""
        return self.label or self.name.replace("_", " ")


PLACES = (-0.75, -0.25, 0.25, 0.75)
"""Where a band is looked for along a grain, −1 to 1: a band of usual width reaches to the next."""


def _axes(what: str) -> tuple[str, ...]:
    return tuple(f"{what}_{axis}" for axis in "xyz")


def _band(grain: int) -> Cause:
    height, *shape = TAU0_BANDS[grain - 1]
    return Cause(
        f"band_grain{grain}", "material", (height,),
        f"a band across grain {grain} has another critical resolved shear stress than its rest",
        f"slip traces along grain {grain}: in a soft band they are dense; "
        "its hardness by nano-indentation at points along it",
        companions=tuple(shape), places=PLACES, label=f"band in grain {grain}",
    )  # fmt: skip


LIBRARY: tuple[Cause, ...] = (
    Cause(
        "isotropic_hardening", "material", ("Q",),
        "the slip systems harden isotropically",
        "a test with load reversals: isotropic hardening widens the elastic range",
        companions=("b",), one_sided=True,
    ),
    Cause(
        "latent_hardening", "material", ("Q_latent",),
        "slip on one system hardens the others",
        "a second loading along another axis: the systems that were at rest yield later",
        companions=("b",), one_sided=True,
    ),
    Cause(
        "second_back_stress", "material", ("c2",),
        "a second back stress goes on growing after the first has saturated",
        "a test to larger strain: the slope of the flow stress long after yield",
        companions=("d2",), one_sided=True,
    ),
    Cause(
        "cold_work", "material", ("x0",),
        "the specimen carries a back stress from prior deformation",
        "a first loading in compression: it would yield earlier or later than in tension",
    ),
    Cause(
        "residual_stress", "material", ("eigenstrain",),
        "residual stress bends the specimen before it is loaded",
        "the curvature of the face before and after one end is cut free",
    ),
    Cause(
        "twinning_asymmetry", "material", ("tau0_antitwinning",),
        "the {112} systems slip more easily in the twinning sense than against it",
        "a test in compression: the flow stresses differ",
        strongly_nonlinear=True, check_always=True,
    ),
    Cause(
        "non_schmid", "material", ("a1",),
        "stresses other than the resolved shear stress move the dislocations",
        "specimens of two orientations with the same Schmid factor",
        strongly_nonlinear=True, check_always=True,
        label="non-Schmid stress",
    ),
    Cause(
        "damaged_skin", "material", ("skin_tau0",),
        "a layer below the milled surface has another critical resolved shear stress",
        "nano-indentation of the face at increasing depth, or a specimen annealed after milling",
        companions=("skin_thickness",),
    ),
    Cause(
        "family_112", "material", ("tau0_112",),
        "the {112} systems have another critical resolved shear stress than the {110} systems",
        "slip traces on the deformed face: which planes carry the steps",
        strongly_nonlinear=True, check_always=True,
        label="{112} family",
    ),
    Cause(
        "family_123", "material", ("tau0_123",),
        "the {123} systems have another critical resolved shear stress than the {110} systems",
        "slip traces on the deformed face: which planes carry the steps",
        strongly_nonlinear=True, check_always=True,
        label="{123} family",
    ),
    Cause(
        "grain_contrast", "material", ("tau0_grain2",),
        "the two grains have different critical resolved shear stresses",
        "nano-indentation of both grains, or their chemistry (interstitials) by atom probe",
        strongly_nonlinear=True,
    ),
    Cause(
        "heterogeneity_grain1", "material", TAU0_MODES[0],
        "the critical resolved shear stress varies inside grain 1",
        "slip traces along grain 1, and its hardness by nano-indentation at points along it",
        label="heterogeneity of grain 1",
    ),
    Cause(
        "heterogeneity_grain2", "material", TAU0_MODES[1],
        "the critical resolved shear stress varies inside grain 2",
        "slip traces along grain 2, and its hardness by nano-indentation at points along it",
        label="heterogeneity of grain 2",
    ),
    _band(1),
    _band(2),
    Cause(
        "rate_sensitivity", "material", ("n", "K"),
        "the flow stress depends on the rate otherwise than assumed",
        "a jump of the stage speed, or a longer hold, in the plastic range",
    ),
    Cause(
        "hold_time", "material", ("hold_time_error",),
        "the holds last longer or shorter than stamped, and the load relaxes for as long",
        "the log of the stage controller beside the time stamps of the images",
        label="length of the holds",
    ),
    Cause(
        "elastic_stiffness", "material", ("elastic_scale",),
        "the crystal is stiffer or softer than its elastic constants say",
        "the slope of an unloading with the section measured beforehand",
    ),
    Cause(
        "elastic_anisotropy", "material", ("C44_scale",),
        "the elastic anisotropy is not that of the constants",
        "the elastic slopes of specimens of two orientations",
    ),
    Cause(
        "misorientation_grain1", "microstructure", _axes("rotation_grain1"),
        "grain 1 is oriented otherwise than its EBSD says",
        "EBSD of grain 1 anew, on the prism itself",
        label="misorientation of grain 1",
    ),
    Cause(
        "misorientation_grain2", "microstructure", _axes("rotation_grain2"),
        "grain 2 is oriented otherwise than its EBSD says",
        "EBSD of grain 2 anew, on the prism itself",
        label="misorientation of grain 2",
    ),
    Cause(
        "ebsd_frame", "microstructure", _axes("rotation_frame"),
        "the EBSD frame is turned against the specimen",
        "the angle between the EBSD map and the edges of the prism",
        label="EBSD frame",
    ),
    Cause(
        "lattice_gradient_grain1", "microstructure", _axes("lattice_gradient_grain1"),
        "the lattice of grain 1 turns along the specimen",
        "EBSD of grain 1 on a fine grid along the face",
        label="lattice gradient in grain 1",
    ),
    Cause(
        "lattice_gradient_grain2", "microstructure", _axes("lattice_gradient_grain2"),
        "the lattice of grain 2 turns along the specimen",
        "EBSD of grain 2 on a fine grid along the face",
        label="lattice gradient in grain 2",
    ),
    Cause(
        "boundary_position", "microstructure", ("boundary_shift",),
        "the grain boundary lies elsewhere along the specimen",
        "EBSD of the face and of both sides of the prism",
        strongly_nonlinear=True,
        label="position of the grain boundary",
    ),
    Cause(
        "boundary_tilt", "microstructure", ("boundary_tilt_x", "boundary_tilt_z"),
        "the grain boundary is inclined otherwise",
        "the trace of the boundary on the sides of the prism",
        label="tilt of the grain boundary",
    ),
    Cause(
        "boundary_bow", "microstructure", ("boundary_bow",),
        "the grain boundary is curved",
        "the trace of the boundary on the sides of the prism",
        strongly_nonlinear=True,
        label="bow of the grain boundary",
    ),
    Cause(
        "section_depth", "microstructure", ("depth_scale",),
        "the section is deeper or shallower than drawn",
        "an image of the broken section, or of the end of the prism",
        label="depth of the section",
    ),
    Cause(
        "apex_off_centre", "microstructure", ("apex_shift",),
        "the apex line is not below the middle of the face",
        "an image of the broken section, or of the end of the prism",
        label="apex off centre",
    ),
    Cause(
        "apex_not_proportional", "boundary", ("apex_curvature",),
        "the apex of the moving end does not follow its edge in proportion",
        "images of the sides of the prism during loading",
    ),
    Cause(
        "end_rotation", "boundary", ("end_rotation",),
        "an end face turns in the plane of the images",
        "the motion of the rim on both sides of the end",
    ),
    Cause(
        "end_shear", "boundary", ("end_shear",),
        "an end face moves sideways",
        "the motion of the rim beyond the end",
    ),
    Cause(
        "stretch_not_proportional", "boundary", ("stretch_curvature",),
        "the elongation is not proportional to the stage travel within a loading phase",
        "the elongation of each image by correlation of the rim",
    ),
    Cause(
        "load_gain", "instrument", ("load_gain",),
        "the load cell's gain or the section ratio is off",
        "calibrate the load cell; measure both sections",
    ),
    Cause(
        "load_offset", "instrument", ("load_offset",),
        "the load has a constant offset",
        "read the load before mounting and after failure",
    ),
    Cause(
        "load_drift", "instrument", ("load_drift",),
        "the load drifts with time",
        "record the load of an unloaded cell for as long as the test",
    ),
    Cause(
        "load_lag", "instrument", ("load_lag",),
        "the clocks of the load cell and of the images differ",
        "a jerk of the stage that both record, or one clock for both",
        strongly_nonlinear=True, check_always=True, kinked=True,
    ),
    Cause(
        "height_scale", "instrument", ("height_scale",),
        "the heights are scaled wrongly",
        "a step-height standard under the same optics",
    ),
    Cause(
        "fixed_pattern", "instrument", ("fixed_pattern",),
        "a part of the flat pattern is left in the images",
        "images of the flat anew, under the optics and at the place of the test",
    ),
    Cause(
        "height_drift", "instrument", ("height_drift",),
        "the heights drift with time",
        "a mark on the die beside the specimen, in the same images",
        unseen="the stage refocuses, so that the mean height of every image is free",
    ),
    Cause(
        "magnification_drift", "instrument", ("magnification_drift",),
        "the magnification drifts with time",
        "images of an unloaded surface over the same time",
    ),
    Cause(
        "scan_distortion", "instrument", ("scan_shear_drift",),
        "the field of the images is sheared more and more",
        "images of an unloaded surface over the same time",
    ),
    Cause(
        "tilt_drift", "instrument", ("tilt_drift",),
        "the field of the images tilts across the specimen with time",
        "images of an unloaded surface over the same time",
    ),
)  # fmt: skip

NUMERICS = Cause(
    "discretisation", "numerics", (DISCRETISATION.name,),
    "the mesh or the time steps of the simulation are too coarse",
    "the same simulation on a finer mesh and with smaller steps",
)  # fmt: skip
"""Scored along the finer-minus-working difference; its parameter is the missing share of it."""
