"""What a planner of one's own decides passes one boundary, whoever asks it."""

import ast
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "meal_bayes"
WITHIN = {  # the boundary, policies that wrap another one, and the check of a planner
    "planners/solver.py", "trials/faults.py", "testing/solver.py",
}  # fmt: skip


def asked(path):
    """Yield the lines of a file that ask a policy directly."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            owner = node.func.value
            name = getattr(owner, "id", getattr(owner, "attr", ""))
            if node.func.attr == "decide" and name.strip("_") == "policy":
                yield node.lineno


def test_no_policy_is_asked_past_the_boundary():
    places = {
        path.relative_to(PACKAGE).as_posix(): lines
        for path in sorted(PACKAGE.rglob("*.py"))
        if (lines := list(asked(path)))
    }
    assert set(places) == WITHIN, places
