"""Publications of the methods that a run has used, as BibTeX."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Reference:
    """A publication.

    Attributes:
        used_for: what it is used for here.
        bibtex: its entry.
    """

    used_for: str
    bibtex: str


def _entry(kind: str, key: str, **fields: str) -> str:
    lines = (f"  {name} = {{{value}}}," for name, value in fields.items())
    return "\n".join((f"@{kind}{{{key},", *lines, "}"))


REFERENCES: tuple[Reference, ...] = (
    Reference(
        "identification of crystal plasticity from a micro-prism, its images and loads",
        _entry(
            "article", "Bertin2016",
            author="Bertin, M. and Du, C. and Hoefnagels, J. P. M. and Hild, F.",
            title="Crystal plasticity parameter identification with {3D} measurements and "
            "{Integrated Digital Image Correlation}",
            journal="Acta Materialia", volume="116", pages="321--331", year="2016",
        ),
    ),
    Reference(
        "global correlation of the images on finite-element functions",
        _entry(
            "article", "Besnard2006",
            author="Besnard, G. and Hild, F. and Roux, S.",
            title="``Finite-element'' displacement fields analysis from digital images: "
            "application to {Portevin--Le Ch{\\^a}telier} bands",
            journal="Experimental Mechanics", volume="46", number="6", pages="789--803",
            year="2006",
        ),
    ),
    Reference(
        "integrated correlation: the parameters are identified from the images themselves",
        _entry(
            "inproceedings", "Leclerc2009",
            author="Leclerc, H. and P{\\'e}ri{\\'e}, J.-N. and Roux, S. and Hild, F.",
            title="Integrated digital image correlation for the identification of mechanical "
            "properties",
            booktitle="Computer Vision/Computer Graphics Collaboration Techniques (MIRAGE 2009)",
            series="Lecture Notes in Computer Science", volume="5496", pages="161--171",
            publisher="Springer", year="2009",
        ),
    ),
    Reference(
        "integrated correlation",
        _entry(
            "article", "Rethore2010",
            author="R{\\'e}thor{\\'e}, J.",
            title="A fully integrated noise robust strategy for the identification of "
            "constitutive laws from digital images",
            journal="International Journal for Numerical Methods in Engineering",
            volume="84", number="6", pages="631--660", year="2010",
        ),
    ),
    Reference(
        "crystal law",
        _entry(
            "article", "Meric1991a",
            author="M{\\'e}ric, L. and Poubanne, P. and Cailletaud, G.",
            title="Single crystal modeling for structural calculations: part 1 -- model "
            "presentation",
            journal="Journal of Engineering Materials and Technology", volume="113",
            number="1", pages="162--170", year="1991",
        ),
    ),
    Reference(
        "crystal law in finite elements",
        _entry(
            "article", "Meric1991b",
            author="M{\\'e}ric, L. and Cailletaud, G.",
            title="Single crystal modeling for structural calculations: part 2 -- finite "
            "element implementation",
            journal="Journal of Engineering Materials and Technology", volume="113",
            number="1", pages="171--182", year="1991",
        ),
    ),
    Reference(
        "slip of each grain from images and orientations, without a law",
        _entry(
            "article", "Vermeij2022",
            author="Vermeij, T. and Peerlings, R. H. J. and Geers, M. G. D. and "
            "Hoefnagels, J. P. M.",
            title="Automated identification of slip system activity fields from digital image "
            "correlation data",
            journal="Acta Materialia", volume="243", pages="118502", year="2022",
        ),
    ),
    Reference(
        "evidence of a cause by Laplace's approximation",
        _entry(
            "article", "MacKay1992",
            author="MacKay, D. J. C.", title="Bayesian interpolation",
            journal="Neural Computation", volume="4", number="3", pages="415--447", year="1992",
        ),
    ),
    Reference(
        "prior of a cause, whose scale says what is usual and not what is possible",
        _entry(
            "article", "Lange1989",
            author="Lange, K. L. and Little, R. J. A. and Taylor, J. M. G.",
            title="Robust statistical modeling using the t distribution",
            journal="Journal of the American Statistical Association", volume="84",
            number="408", pages="881--896", year="1989",
        ),
    ),
    Reference(
        "correction of the working mesh and steps by the difference to finer ones",
        _entry(
            "article", "Stetter1978",
            author="Stetter, H. J.",
            title="The defect correction principle and discretization methods",
            journal="Numerische Mathematik", volume="29", pages="425--443", year="1978",
        ),
    ),
    Reference(
        "test for serial correlation of the load residual",
        _entry(
            "article", "Ljung1978",
            author="Ljung, G. M. and Box, G. E. P.",
            title="On a measure of lack of fit in time series models",
            journal="Biometrika", volume="65", number="2", pages="297--303", year="1978",
        ),
    ),
    Reference(
        "mesh of the specimen",
        _entry(
            "article", "Geuzaine2009",
            author="Geuzaine, C. and Remacle, J.-F.",
            title="Gmsh: a {3-D} finite element mesh generator with built-in pre- and "
            "post-processing facilities",
            journal="International Journal for Numerical Methods in Engineering",
            volume="79", number="11", pages="1309--1331", year="2009",
        ),
    ),
)  # fmt: skip
