"""Reports of figures, judged anew."""

from __future__ import annotations

import operator

RELATIONS = {">=": operator.ge, "<=": operator.le, ">": operator.gt, "<": operator.lt}


def holds_by_its_rule(report) -> bool:
    """`holds` worked out anew from the JSON alone: the rule is what stands in the claim's last brackets."""
    measured = report["measured"]
    rule = report["claim"].removesuffix(")").rsplit("(", 1)[1]
    verdicts = []
    for condition in rule.split(", "):
        left, relation, right = condition.split()
        bound = measured[right] if right in measured else float(right)
        # What could not be measured, null in JSON, keeps no condition.
        found = float("nan") if measured[left] is None else measured[left]
        verdicts.append(RELATIONS[relation](found, bound))
    return all(verdicts)
