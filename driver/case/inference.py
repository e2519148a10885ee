"""What is identified and diagnosed."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from driver.case.messages import refusal
from driver.case.values import Count, FileName, Positive, Table
from driver.common.errors import one_of
from solver_adapters.material import MATERIAL_DECLARATIONS


def _known_parameters(names: tuple[str, ...]) -> tuple[str, ...]:
    known = [parameter.name for parameter in MATERIAL_DECLARATIONS]
    for name in names:
        if name not in known:
            raise refusal(one_of(name, known), found=f'"{name}"')
    if not names:
        raise refusal("at least one name of a material parameter")
    return _each_once(names)


def _named_causes(names: Literal["all"] | tuple[str, ...]) -> Literal["all"] | tuple[str, ...]:
    if names == "all":
        return "all"
    if not names:
        raise refusal('at least one name of a cause, or "all"')
    return _each_once(names)


def _each_once(names: tuple[str, ...]) -> tuple[str, ...]:
    for name in names:
        if names.count(name) > 1:
            raise refusal("each name once", found=f'"{name}" {names.count(name)} times')
    return names


Parameters = Annotated[tuple[str, ...], AfterValidator(_known_parameters)]
Causes = Annotated[Literal["all"] | tuple[str, ...], AfterValidator(_named_causes)]


class Identification(Table):
    """Unknowns of the identification and their priors."""

    parameters: Parameters = Field(
        default=("tau0", "c", "d"),
        description="a list of names of material parameters",
    )
    order: Literal["joint", "paper"] = Field(
        default="joint", description='which parameters are free in which stage, "joint" or "paper"'
    )
    prior: Literal["gaussian", "tikhonov", "none"] = Field(
        default="gaussian",
        description='what is known of λ\'s and law: "gaussian", "tikhonov", "none"',
    )
    lambda_star: Positive | None = Field(
        default=None, description="weight of a tikhonov prior, as in the paper"
    )
    prior_width: dict[str, Positive] = Field(
        default_factory=dict,
        description="standard deviation of the logarithm of a parameter, 1.0 where not given",
    )
    starts: Count = Field(
        default=1, description="number of starts; those after the first are drawn"
    )
    max_iterations: Count = Field(
        default=12, description="largest number of Gauss–Newton iterations"
    )

    def width(self, parameter: str) -> float:
        """Prior standard deviation of log(p/p0) [-]."""
        return self.prior_width.get(parameter, 1.0)

    @model_validator(mode="after")
    def _weight_of_its_prior(self) -> Self:
        if self.prior == "tikhonov" and self.lambda_star is None:
            raise refusal('a number above 0 with prior = "tikhonov"', "lambda_star")
        if self.prior != "tikhonov" and self.lambda_star is not None:
            raise refusal(
                f'nothing with prior = "{self.prior}"', "lambda_star", f"{self.lambda_star:g}"
            )
        return self

    @model_validator(mode="after")
    def _widths_of_parameters(self) -> Self:
        for name in self.prior_width:
            if name not in self.parameters:
                raise refusal(
                    "one of " + ", ".join(self.parameters), "prior_width", f'the name "{name}"'
                )
        return self


class DiagnosisTable(Table):
    """Which causes are tried and how."""

    causes: Causes = Field(default="all", description='"all" or a list of names of causes')
    held_out_cycle: Literal["last", "none"] | Count = Field(
        default="last", description='"last", "none" or the number of a cycle'
    )
    cause_files: tuple[FileName, ...] = Field(
        default=(), description="a list of files with causes of your own"
    )
    refit: Count = Field(default=5, description="number of causes refitted nonlinearly")
