"""Evaluates reports of figures again."""

from __future__ import annotations

import operator

RELATIONS = {">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt}


def holds_by_its_rule(report) -> bool:
    """Return `holds`, evaluated from the JSON alone: the rule is in the claim's last brackets."""
    measured = report["measured"]
    rule = report["claim"].removesuffix(")").rsplit("(", 1)[1]
    verdicts = []
    for condition in rule.split(", "):
        left, relation, right = condition.split()
        bound = measured[right] if right in measured else float(right)
        # A number that was not measured, null in JSON, fails every condition.
        found = float("nan") if measured[left] is None else measured[left]
        verdicts.append(RELATIONS[relation](found, bound))
    return all(verdicts)
