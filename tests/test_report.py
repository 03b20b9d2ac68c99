"""Findings and reports: strict, deterministic JSON."""

from __future__ import annotations

import json
import math

from grassfire.report import Finding, OperationFigures, Report, Severity


def figures(**changes: object) -> OperationFigures:
    values: dict[str, object] = {
        "strategy": "offset",
        "tool": 1,
        "moves": 12,
        "lines": 8,
        "arcs": 4,
        "cut_length_mm": 120.0,
        "rapid_length_mm": 30.0,
        "time_s": 9.5,
        "reachable_area_mm2": 400.0,
        "unreachable_area_mm2": 1.5,
    }
    return OperationFigures(**{**values, **changes})  # type: ignore[arg-type]


def test_severities_are_ordered() -> None:
    ranks = [severity.rank for severity in Severity]
    assert ranks == sorted(ranks)
    assert Severity.ERROR.rank > Severity.WARNING.rank > Severity.REPAIR.rank > Severity.INFO.rank


def test_finding_round_trips_through_json() -> None:
    finding = Finding(Severity.REPAIR, "gap-closed", "gap closed", "2F", (1.0, -2.5), 1e-3)
    data = json.loads(json.dumps(finding.to_dict()))
    assert data == {
        "severity": "repair",
        "code": "gap-closed",
        "message": "gap closed",
        "handle": "2F",
        "place": [1.0, -2.5],
        "size": 1e-3,
    }
    assert "#2F" in str(finding)
    assert "(1, -2.5)" in str(finding)


def test_operation_holds_every_figure_of_the_contract() -> None:
    assert list(figures().to_dict()) == [
        "name",
        "strategy",
        "tool",
        "moves",
        "lines",
        "arcs",
        "cut_length_mm",
        "rapid_length_mm",
        "time_s",
        "reachable_area_mm2",
        "uncut_area_mm2",
        "unreachable_area_mm2",
        "max_gouge_mm",
        "max_engagement_deg",
        "mean_engagement_deg",
        "rapids_in_stock",
        "retracts",
    ]


def test_json_is_strict_and_repeatable() -> None:
    report = Report(
        job="demo",
        findings=(Finding(Severity.INFO, "note", "naïve", size=math.nan),),
        operations=(figures(max_gouge_mm=math.inf),),
        seconds={"dxf": 0.25, "plan": 0.5},
        verified=True,
    )
    text = report.to_json()
    assert text == report.to_json()
    data = json.loads(text, parse_constant=lambda name: (_ for _ in ()).throw(ValueError(name)))
    assert data["findings"][0]["size"] is None
    assert data["operations"][0]["max_gouge_mm"] is None
    assert list(data["seconds"]) == ["dxf", "plan"]
    assert "seconds" not in json.loads(report.to_json(include_seconds=False))


def test_worst_severity() -> None:
    assert Report(job="empty").worst() is None
    mixed = (
        Finding(Severity.INFO, "a", "a"),
        Finding(Severity.WARNING, "b", "b"),
        Finding(Severity.REPAIR, "c", "c"),
    )
    assert Report(job="mixed", findings=mixed).worst() is Severity.WARNING
