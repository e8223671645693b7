"""What follows from warnings: others that are not said where their cause is, contradictions, and the first sentence."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from orip.bundle.groups.words import CODE as CONTRADICTION
from orip.bundle.groups.words import EXPLAINED
from orip.bundle.verdict import MISTAKE
from orip.errors import UNREAD_FILE, ProjectWarning
from orip.mistakes.mistake import GIVEN_ORIENTATION, REPLACED, mistake_of
from orip.records.results.solution import Diagnosis, Solution
from orip.structs import replace


def comes_first(warning: ProjectWarning) -> bool:
    """Tell whether a warning is about the input, and listed first: misfits may be its consequence."""
    return warning.code == UNREAD_FILE or mistake_of(warning.code).comes_first


def without_consequences(found: Iterable[ProjectWarning], causes: Sequence[ProjectWarning]) -> list[ProjectWarning]:
    """Return the warnings that follow from none of the causes."""
    return [warning for warning in found if not any(follows(warning, cause) for cause in causes)]


def follows(warning: ProjectWarning, cause: ProjectWarning) -> bool:
    """Tell whether a warning says what follows from another one; nothing follows from what has the same consequence."""
    own = mistake_of(warning.code).consequences
    return any(
        consequence not in own
        and (consequence.warnings is None or warning.code in consequence.warnings)
        and (not consequence.of_same_photo or _is_of_same_photo(warning, cause))
        for consequence in mistake_of(cause.code).consequences
    )


def groups_that_follow(causes: Iterable[ProjectWarning]) -> set[str]:
    """Return words of the groups whose contradictions follow from warnings."""
    consequences = (one for cause in causes for one in mistake_of(cause.code).consequences)
    return {word for consequence in consequences for word in consequence.groups}


def _is_of_same_photo(warning: ProjectWarning, cause: ProjectWarning) -> bool:
    """Tell whether a warning is about a photo that its cause is about, or about the start that such photos spoil."""
    named = set(f"{cause.where} {cause.text.split(';')[0]}".replace(":", " ").replace(",", " ").split())
    if warning.code == REPLACED:
        return cause.where.startswith("photo ")
    if warning.where.startswith("photo "):
        name = warning.where.removeprefix("photo ")
        return warning.where == cause.where or (warning.code == GIVEN_ORIENTATION and name in named)
    return cause.where.removeprefix("photo ") in f"{warning.where} {warning.text}".split()[:3]


_CONTROL_POINT = "control point "


def judged(
    solution: Solution,
    mistaken: Sequence[ProjectWarning],
    gathered: Sequence[ProjectWarning],
    taken: Sequence[ProjectWarning],
) -> Solution:
    """Return a solution with what its first sentence has of the warnings; one that fits, and is wrong, is doubtful."""
    wrong = [_explained(found) for found in (*mistaken, *gathered) if _is_serious(found)]
    # measurements that are wrong explain what does not fit, and nothing else is said of it
    is_doubtful = solution.status == "doubtful"
    contradicts = any(found.code == CONTRADICTION for found in solution.diagnosis)
    measured = [
        found
        for found, mistake in ((found, mistake_of(found.code)) for found in gathered)
        if (is_doubtful and mistake.explains_misfit) or (contradicts and mistake.contradicts_others)
    ]
    others = [_diagnosis(found) for found in (*measured, *mistaken, *taken) if not _is_serious(found)]
    status = "doubtful" if wrong and solution.status == "converged" else solution.status
    diagnosis = (*wrong, *_after_causes(solution, (*mistaken, *(gathered if wrong else measured))), *others)
    return replace(solution, status=status, diagnosis=diagnosis)


def _is_serious(warning: ProjectWarning) -> bool:
    """Tell whether a block that fits is doubtful by what a warning says."""
    mistake = mistake_of(warning.code)
    return bool(mistake.words) and mistake.is_serious


def _explained(warning: ProjectWarning) -> Diagnosis:
    words = mistake_of(warning.code).words
    return Diagnosis(EXPLAINED, warning.where, words, "first correct it as the warning says")


def _diagnosis(warning: ProjectWarning) -> Diagnosis:
    """Return what the first sentence has of a warning that says what is probably wrong."""
    if mistake_of(warning.code).words:
        return _explained(warning)
    if warning.code == REPLACED:
        text = "not from the given values, see the warning"
    elif warning.where:
        text = f"see the warning about {warning.where}"
    else:
        text = "see the warning"
    return Diagnosis(MISTAKE, warning.where, text, "see the warning")


def _after_causes(solution: Solution, mistaken: Sequence[ProjectWarning]) -> tuple[Diagnosis, ...]:
    """Return the diagnosis; where the cause of a contradiction is named, that is to be mended, and nothing else set.

    A wrong control point may have displaced itself or others: what is then said of groups follows from it.
    """
    causes = {warning.where for warning in mistaken}
    exchanged = [warning.text.split() for warning in mistaken if warning.where.startswith(_CONTROL_POINT)]
    causes |= {
        found.where
        for found in solution.diagnosis
        if found.where.startswith(_CONTROL_POINT)
        and any(found.where.removeprefix(_CONTROL_POINT) in words for words in exchanged)
    }
    follows = groups_that_follow(mistaken)
    solution = replace(
        solution,
        diagnosis=tuple(
            found
            for found in solution.diagnosis
            if not (found.code == CONTRADICTION and any(word in found.where for word in follows))
        ),
    )
    contradictions = [found for found in solution.diagnosis if found.code == CONTRADICTION]
    if contradictions and contradictions[0].where in causes and contradictions[0].where.startswith(_CONTROL_POINT):
        return tuple(found for found in solution.diagnosis if found.code != CONTRADICTION)
    return tuple(
        replace(found, code=EXPLAINED, remedy=f"first correct the {found.where} as the warning says")
        if found.code == CONTRADICTION and found.where in causes
        else found
        for found in solution.diagnosis
    )
