"""The options that say how a bundle is adjusted and which gates its solution has to pass: of `solve` and of `run`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import typer

from orip.errors import UsageError

if TYPE_CHECKING:
    from orip.bundle.methods import Method

Snoop = Annotated[
    bool, typer.Option("--snoop", help="Search for blunders and leave them out, instead of reducing weights.")
]
Sigma0 = Annotated[
    Literal["apriori", "posteriori"] | None,
    typer.Option("--sigma0", help="With --snoop: sigma0 is 1 (apriori, default), or estimated (posteriori)."),
]
Alpha = Annotated[
    float | None,
    typer.Option(
        "--alpha",
        min=1e-9,
        max=0.5,
        help="With --snoop: error probability of one test (default: 0.05 of all together).",
    ),
]
Prune = Annotated[
    bool, typer.Option("--prune", help="Hold camera parameters that are not significant at zero, one after the other.")
]
VarianceComponents = Annotated[
    bool,
    typer.Option(
        "--variance-components",
        help="Estimate the a-priori error of each group of observations, and adjust with these errors.",
    ),
]
Check = Annotated[
    list[str] | None,
    typer.Option("--check", metavar="EXPR", help="A gate such as 'sigma0<=1.5'; exit code 5 if it fails. Repeatable."),
]


class MethodOptions(NamedTuple):
    """How to adjust, as given on the command line."""

    snoop: Snoop = False
    sigma0: Sigma0 = None
    alpha: Alpha = None
    prune: Prune = False
    variance_components: VarianceComponents = False
    check: Check = None

    def method(self) -> Method:
        """Return the method of the adjustment.

        Raises
        ------
        UsageError
            If settings of data snooping are given without it.
        """
        from orip.bundle.methods import Method

        if not self.snoop and (self.sigma0 is not None or self.alpha is not None):
            message = "--sigma0 and --alpha need --snoop; add --snoop, or leave them out"
            raise UsageError(message)
        if not self.snoop:
            return Method(None, self.prune, self.variance_components)
        from orip.bundle.snooping.search import SnoopingSettings

        return Method(SnoopingSettings(self.sigma0 or "apriori", self.alpha), self.prune, self.variance_components)
