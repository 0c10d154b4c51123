"""What is shown of an inspection."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from fringeworks.evaluate.inspect import Check, Inspection, recipe_hash
from fringeworks.report.display import maps_of
from fringeworks.report.kind import Kind, Rows, Word, describe
from fringeworks.report.kinds.budget import COLUMNS as BUDGET_COLUMNS
from fringeworks.report.kinds.budget import (
    EXPLAINED,
    budget_blocks,
    monte_carlo_figures,
    monte_carlo_text,
)
from fringeworks.report.kinds.budget import figures as budget_figures
from fringeworks.report.kinds.budget import rows as budget_rows
from fringeworks.report.page.blocks import Block, Chapter, Picture, Table, Text
from fringeworks.report.page.chapter import Context, judged_block
from fringeworks.report.page.parts import (
    facts,
    findings_block,
    provenance_block,
    reasons_table,
)
from fringeworks.report.page.surfaces import surface_block
from fringeworks.report.sheets import titled
from fringeworks.report.summary import summarise, told
from fringeworks.report.verdicts import allowed
from fringeworks.types import HeightMap, PartTolerance, Provenance, Recipe, day
from fringeworks.types.numbers import SHARE, UNKNOWN, limit, number, percent, sigma_text
from fringeworks.types.report_head import PART_HEAD

if TYPE_CHECKING:
    from fringeworks.report.drawing import Figure

COLUMNS = ("tolerance", "value", "± σ", "limits", "verdict")
"""Columns of the table of checks in the terminal."""
REPORT_COLUMNS = ("tolerance", "measured", "nominal", "min", "max", "value", "U (95 %)", "verdict")
"""Columns of the table of checks in a report."""
MOST_PICTURES = 60
"""Tolerances whose areas a report draws: a drawing has fewer."""


def figures(inspection: Inspection) -> dict[str, Any]:
    """The figures of the surface, the checks and the verdict."""
    checks = [
        {
            "name": check.tolerance.name,
            "quantity": check.tolerance.quantity,
            "areas": list(check.tolerance.areas),
            "datums": list(check.tolerance.zone.datums),
            "value": check.value if np.isfinite(check.value) else None,
            "sigma": check.sigma if np.isfinite(check.sigma) else None,
            "unit": check.unit,
            "nominal": check.tolerance.target,
            "smallest": check.tolerance.low,
            "largest": check.tolerance.high,
            "verdict": check.verdict,
            "why": check.why,
            "budget": None if check.budget is None else budget_figures(check.budget),
            "monte_carlo": None
            if check.monte_carlo is None
            else monte_carlo_figures(check.monte_carlo),
        }
        for check in inspection.checks
    ]
    return summarise(inspection.surface) | {
        "verdict": inspection.verdict,
        "checks": checks,
        **told(inspection),
    }


def words(inspection: Inspection, _: dict[str, Any]) -> Iterator[Word]:
    """The checks as a table, and the verdict."""
    yield Rows(COLUMNS, [_row(check) for check in inspection.checks], ruled=True)
    if any(check.monte_carlo for check in inspection.checks):
        yield from budget_words(inspection)
    yield from inspection.findings
    judged = bool(inspection.checks)
    yield inspection.verdict if judged else "nothing is judged: the recipe has no tolerances"


def _row(check: Check) -> list[str]:
    one = check.tolerance
    unit = one.unit(check.unit)
    return [
        one.name,
        number(check.value, check.sigma, unit),
        sigma_text(check.sigma) if unit != SHARE else UNKNOWN,
        allowed(one, check.unit),
        f"{check.verdict}: {check.why}" if check.why else check.verdict,
    ]


def picture(inspection: Inspection, name: str | None) -> Figure:
    """The part with its areas, and the values between their limits."""
    from fringeworks.report.inspection_picture import inspection_picture  # needs Matplotlib

    return inspection_picture(titled(name, "Inspection"), inspection)


def chapter(result: Inspection, context: Context) -> Chapter:
    """Tolerances with their verdicts and areas, then the surface."""
    context.verdicts.extend(check.verdict for check in result.checks)
    surface, recipe = result.surface, result.recipe
    values = figures(result)
    rows = [
        ("measured pixels", f"{percent(1.0 - surface.failed_fraction)} of the frame"),
        ("median σ of a pixel", _usual_sigma(result)),
        ("risk of a wrong decision", percent(recipe.risk)),
        ("measured", _day_of(surface.provenance)),
        ("recipe", f"sha256 {recipe_hash(recipe)}"),
        ("rig", _rig_of(surface.provenance)),
    ]
    caption = "The part; pixels outside the recipe's area are left out."
    return Chapter(
        context.name,
        (
            *_tolerances(result),
            facts(rows),
            *judged_block(values, context),
            *_areas(result),
            *_budgets(result),
            surface_block(surface, context, caption, lambda: maps_of(surface)),
            *findings_block(values["findings"]),
            reasons_table(surface.reason),
            *provenance_block(surface.provenance),
        ),
    )


def _day_of(origin: Provenance | None) -> str | None:
    """When the part was measured."""
    return day(origin.date) if origin is not None and origin.date else None


def _rig_of(origin: Provenance | None) -> str | None:
    """The hash of the rig."""
    known = origin is not None and origin.rig_sha256
    return f"sha256 {origin.rig_sha256}" if origin is not None and known else None


def _usual_sigma(result: Inspection) -> str:
    surface = result.surface
    sigma = surface.sigma if isinstance(surface, HeightMap) else surface.sigma_mm
    known = sigma[np.isfinite(sigma)]
    unit = surface.unit if isinstance(surface, HeightMap) else "mm"
    return sigma_text(float(np.median(known)), unit) if known.size else UNKNOWN


def _tolerances(result: Inspection) -> tuple[Block, ...]:
    """Every tolerance: nominal, limits, value, U and verdict."""
    if not result.checks:
        return (Text("Nothing is judged: the recipe has no tolerances."),)
    table = Table.judged(
        REPORT_COLUMNS,
        tuple(_report_row(check) for check in result.checks),
        "Tolerances",
        [check.verdict for check in result.checks],
    )
    known = any(check.budget is not None for check in result.checks)
    return (table, *_datums(result.recipe), Text(_decision(result.recipe.risk, known)))


def _report_row(check: Check) -> tuple[str, ...]:
    one = check.tolerance
    what = f"{_said(one)}: {', '.join(one.areas)}{_under(one)}{_exact(one)}"
    unit = one.unit(check.unit)
    nominal, low, high = (limit(v, unit) for v in (one.target, one.low, one.high))
    value = number(check.value, check.sigma, unit)
    wide = number(check.expanded, check.sigma, unit) if unit != SHARE else UNKNOWN
    verdict = f"{check.verdict}: {check.why}" if check.why else check.verdict
    return one.name, what, nominal, low, high, value, wide, verdict


def _said(one: PartTolerance) -> str:
    """The quantity in words."""
    return one.quantity.replace("_", " ").replace("iso ", "ISO 1101 ")


def _under(one: PartTolerance) -> str:
    """The datums of a tolerance, in their order."""
    return f" to {' | '.join(one.zone.datums)}" if one.zone.datums else ""


def _exact(one: PartTolerance) -> str:
    """The theoretically exact dimensions of a tolerance, and the body that is not a plane."""
    zone = one.zone
    said: list[str] = []
    if zone.body != "plane":
        said.append(zone.body)
    if zone.angle_deg is not None:
        said.append(f"at {limit(zone.angle_deg)}°")
    if one.quantity == "iso_position":
        said.append(f"at ({', '.join(limit(v) for v in zone.at_mm)}) mm")
    if zone.direction is not None:
        said.append(f"along ({', '.join(limit(v) for v in zone.direction)})")
    if zone.association != "minimum-zone":
        said.append(zone.association)
    if zone.located:
        said.append("located by the datums")
    return f"; {', '.join(said)}" if said else ""


def _datums(recipe: Recipe) -> tuple[Block, ...]:
    """What each datum of the tolerances is."""
    used = dict.fromkeys(name for one in recipe.tolerances for name in one.zone.datums)
    if not used:
        return ()
    rows = []
    for name in used:
        one = recipe.datums[name]
        rows.append((name, " and ".join(one.areas), one.body, one.association))
    return (Table(("datum", "areas", "body", "association"), tuple(rows), "Datums (ISO 5459)"),)


def _decision(risk: float, budgets: bool) -> str:
    where = "its parts and its factor k stand in the uncertainty budgets" if budgets else "k = 2"
    return (
        f"U is the expanded uncertainty of the value for 95 %; {where}. A value passes or "
        f"fails where the probability of a wrong decision is at most {percent(risk)} (guard band, "
        "ISO 14253-1); between, it is undecided."
    )


def _budgets(result: Inspection) -> tuple[Block, ...]:
    """The uncertainty budget of each tolerance."""
    found: list[Block] = []
    for check in result.checks[:MOST_PICTURES]:
        found.extend(budget_blocks(check.tolerance.name, check.budget, check.monte_carlo))
    return (*found, Text(EXPLAINED)) if found else ()


def budget_words(inspection: Inspection) -> Iterator[Word]:
    """The budgets of all tolerances, and what Monte Carlo says beside them."""
    for check in inspection.checks:
        if check.budget is None or not check.budget.lines:
            continue
        yield f"uncertainty budget: {check.tolerance.name}"
        yield Rows(BUDGET_COLUMNS, budget_rows(check.budget))
        if check.monte_carlo is not None:
            yield monte_carlo_text(check.monte_carlo, check.unit)


def _areas(result: Inspection) -> tuple[Block, ...]:
    """A picture of each tolerance: its areas, and its value between its limits."""
    from fringeworks.report.inspection_picture import area_picture, backdrop  # needs Matplotlib

    part = backdrop(result.surface)
    pictures = []
    for check in result.checks[:MOST_PICTURES]:
        one = check.tolerance
        datums = " Purple: datums." if one.zone.datums else ""
        caption = (
            f"{one.name}: {_said(one)} of {' and '.join(one.areas)}{_under(one)}. Green: allowed; "
            f"orange: too close to a limit to decide; the bar is U.{datums}"
        )
        pictures.append(Picture(area_picture(result, check, part), caption))
    return tuple(pictures)


def itself(inspection: Inspection) -> Any:
    """The surface that was judged."""
    return inspection.surface


describe(Inspection, Kind(figures, words, picture, chapter, itself, head=PART_HEAD))
