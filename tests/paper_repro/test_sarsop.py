"""The adapter to `pomdpsol`, with programs that stand in for it: good, hanging, failing, lying."""

import stat
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.momdp import Objective, Transition, build_momdp, initial_belief, update_belief
from meal_bayes.planners import Factored, History
from paper_repro.sarsop import (
    AlphaVectorPolicy,
    Sarsop,
    read_policy,
)

LOOK, LIFT, REINIT = range(3)
POLICY = """<?xml version="1.0" encoding="ISO-8859-1"?>
<Policy version="0.1" type="value" model="own.pomdpx"
 xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" xsi:noNamespaceSchemaLocation="policyx.xsd">
<AlphaVector vectorLength="3" numObsValue="2" numVectors="3">
<Vector action="4" obsValue="0">-1.5 2 3e+02 </Vector>
<Vector action="0" obsValue="1">0 0.125 -0 </Vector>
<SparseVector action="2" obsValue="1"><Entry>2 7.5</Entry><Entry>0 -1</Entry></SparseVector>
</AlphaVector> </Policy>
"""


def momdp_of(name="toy", n=1, **options):
    domain = load_domain(name)
    rng = np.random.default_rng(0)
    confusion = rng.dirichlet(np.ones(2), (n, len(domain.behaviors), 2))
    return build_momdp(domain, Query(domain.attributes[:n]), confusion, **options)


def decide(momdp, belief, *vectors):
    return AlphaVectorPolicy(momdp, *vectors).decide(History(belief), np.random.default_rng(0))


@pytest.fixture
def program(tmp_path):
    """Return a function that makes an executable of Python lines, which see `args`."""

    def make(*lines: str, name: str = "pomdpsol") -> Path:
        path = tmp_path / "bin" / name
        path.parent.mkdir(exist_ok=True)
        before = "import os, pathlib, sys, time\nargs = sys.argv[1:]"
        path.write_text("\n".join([f"#!{sys.executable} -S", before, *lines]) + "\n")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        return path

    return make


def solve(momdp, **settings):
    return Sarsop(**settings).solve(momdp, np.random.default_rng(0))


def test_the_program_gets_a_problem_and_its_policy_is_followed(program, tmp_path):
    momdp = momdp_of(n=1, objective=Objective(abstain=True))
    text = (
        '<Policy><AlphaVector vectorLength="2" numObsValue="3" numVectors="2">'
        '<Vector action="0" obsValue="0">90 20</Vector>'
        '<Vector action="1" obsValue="0">10 95</Vector></AlphaVector></Policy>'
    )
    problem = tmp_path / "problem.pomdpx"
    path = program(
        f"pathlib.Path({str(tmp_path / 'args')!r}).write_text('\\n'.join([os.getcwd(), *args]))",
        f"pathlib.Path(args[args.index('--output') + 1]).write_text({text!r})",
        f"pathlib.Path({str(problem)!r}).write_bytes(pathlib.Path(args[-1]).read_bytes())",
    )
    policy = solve(momdp, program=path, seconds=2.5)
    folder, *arguments = (tmp_path / "args").read_text().split("\n")
    assert arguments == [
        "--timeout", "2.5", "--precision", "0.001", "--output", "out.policy", "problem.pomdpx",
    ]  # fmt: skip
    assert not Path(folder).exists()
    assert problem.read_text().startswith("<?xml")
    assert policy.lower_bound == pytest.approx(55.0)
    decision = policy.decide(History(initial_belief(momdp)), np.random.default_rng(0))
    assert decision.action == LOOK
    np.testing.assert_allclose(decision.values[:2], [55.0, 52.5])


def test_the_program_is_found_on_the_path_in_the_environment_or_by_name(program, monkeypatch):
    where = [program("sys.exit(4)", name=name) for name in ("pomdpsol", "other", "third")]
    monkeypatch.setenv("PATH", str(where[0].parent))
    monkeypatch.delenv("MEAL_BAYES_POMDPSOL", raising=False)
    monkeypatch.chdir(where[0].parent.parent)
    for exe, named, path in ((None, None, 0), (None, where[1], 1), (Path("bin/third"), None, 2)):
        if named is not None:
            monkeypatch.setenv("MEAL_BAYES_POMDPSOL", str(named))
        with pytest.raises(SettingsError, match=f"{where[path]} ended with code 4"):
            solve(momdp_of(), program=exe)
    monkeypatch.setenv("MEAL_BAYES_POMDPSOL", str(where[0].parent / "none"))
    with pytest.raises(SettingsError, match=r"No program .*none.* here.*MEAL_BAYES_POMDPSOL"):
        solve(momdp_of())


@pytest.mark.long
def test_a_program_that_hangs_is_ended(program, tmp_path, eventually, running):
    pid = tmp_path / "pid"
    path = program(f"pathlib.Path({str(pid)!r}).write_text(str(os.getpid()))", "time.sleep(1000)")
    with pytest.raises(SettingsError, match=r"had not ended after 2\.1 s"):
        solve(momdp_of(), program=path, seconds=0.1, patience=2.0)
    eventually(lambda: not running(int(pid.read_text())), "a program was left running")


def test_a_program_that_fails_is_told_with_its_last_words(program):
    path = program(
        "print('x' * 5000)", "print('\\x1b[31mno memory\\n\\x00left', flush=True)", "sys.exit(3)"
    )
    with pytest.raises(
        SettingsError, match=r"ended with code 3; its output ends: .*no memory left$"
    ):
        solve(momdp_of(), program=path)
    path.write_bytes(b"\x00\x01\x02")
    with pytest.raises(SettingsError, match="cannot be run"):
        solve(momdp_of(), program=path)


@pytest.mark.parametrize(
    ("line", "kind", "message"),
    [
        ("pass", SettingsError, "wrote no policy; its output ends: none"),
        ("pathlib.Path('out.policy').write_text('<Pol')", DataError, "is no policy"),
        (
            "pathlib.Path('out.policy').write_text('<Policy><AlphaVector vectorLength=\"3\" "
            'numVectors="1"><Vector action="0" obsValue="0">1 2 3</Vector>'
            "</AlphaVector></Policy>')",
            DataError,
            "wrote a policy that does not fit: Alpha vectors of 3 values",
        ),
    ],
)  # fmt: skip
def test_a_policy_that_is_none_is_told(program, line, kind, message):
    with pytest.raises(kind, match=message):
        solve(momdp_of(), program=program(line))


def test_what_the_format_cannot_hold_is_told(program):
    path = program("sys.exit(1)")
    for momdp, message in (
        (momdp_of(precision=4.0), "precision=inf"),
        (momdp_of(objective=Objective(discount=1.0)), "discount below 1"),
        (momdp_of("ispy32", 9), "9 attributes"),
    ):
        with pytest.raises(SettingsError, match=message):
            solve(momdp, program=path)


def test_the_real_program_agrees(pomdpsol):
    """Its bound on a small problem is ours."""
    momdp = momdp_of("toy", 2, objective=Objective(abstain=True))
    ours = Factored().solve(momdp, np.random.default_rng(0)).upper_bound
    assert ours - 0.5 < solve(momdp, program=pomdpsol).lower_bound < ours


def test_dense_and_sparse_vectors_are_read(tmp_path):
    (tmp_path / "own.policy").write_text(POLICY)
    vectors, x, action = read_policy(tmp_path / "own.policy")
    np.testing.assert_array_equal(vectors, [[-1.5, 2.0, 300.0], [0.0, 0.125, 0.0], [-1.0, 0, 7.5]])
    assert (x.tolist(), action.tolist()) == ([0, 1, 1], [4, 0, 2])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('vectorLength="3"', 'vectorLength="4"'), "a vector has 3 values; expected 4"),
        (('numVectors="3"', 'numVectors="4"'), "found 3 vectors; it promises 4"),
        (("-1.5 2", "-1.5 nan"), "expected 3 finite ones"),
        (("<Entry>2 7.5", "<Entry>3 7.5"), "index 3"),
        (("</AlphaVector>", ""), "mismatched tag"),
    ],
)
def test_a_damaged_policy_is_told(tmp_path, change, message):
    (tmp_path / "own.policy").write_text(POLICY.replace(*change, 1))
    with pytest.raises(DataError, match=f"is no policy of SARSOP.*({message})"):
        read_policy(tmp_path / "own.policy")


def test_the_joint_belief_runs_in_the_querys_bit_order():
    """Value y = 1 is "not red, heavy": the first attribute is the leading bit."""
    momdp = momdp_of(n=2, prior=[0.1, 0.8])
    vectors = np.array([[0, 900.0, 0, 0], [0, 0, 900.0, 0]])
    decision = decide(momdp, initial_belief(momdp), vectors, [0, 0], [LOOK, LIFT])
    np.testing.assert_allclose(decision.values[:2], [900 * 0.9 * 0.8, 900 * 0.1 * 0.2])
    assert decision.action == LOOK
    assert np.isnan(decision.values[REINIT])


def test_a_report_is_valued_exactly_and_needs_no_vector():
    momdp = momdp_of(n=2, prior=[0.9, 0.2])
    belief = initial_belief(momdp)
    worth = -100 + 200 * 0.9 * 0.8
    for look, action in ((worth - 1, 3 + 0b10), (worth + 1, LOOK)):
        decision = decide(momdp, belief, [[look] * 4, [999.0] * 4], [0, 0], [LOOK, 3])
        assert decision.action == action  # a report's own vector counts for nothing
        assert decision.values[-1] == pytest.approx(worth)


def test_illegal_behaviors_are_never_taken():
    """At x1: lift and look are not legal there."""
    momdp = momdp_of(objective=Objective(abstain=True, correct=10.0, incorrect=-30.0))
    belief = initial_belief(momdp).at(1)
    decision = decide(momdp, belief, [[77.0, 77.0], [66.0, 66.0]], [1, 1], [LIFT, LOOK])
    assert decision.action == momdp.abstention
    assert decision.values[-1] == 0.0


def test_used_up_percepts_end_a_loop():
    momdp = momdp_of(limit=2)
    belief = initial_belief(momdp)
    actions = []
    for _ in range(3):
        actions.append(decide(momdp, belief, [[99.9, 99.9]], [0], [LOOK]).action)
        belief = update_belief(belief, momdp, Transition(LOOK, 0, np.array([1], dtype=np.int8)))
    assert actions[:2] == [LOOK, LOOK]
    assert actions[2] >= momdp.n_behaviors


def test_vectors_of_another_problem_are_told():
    with pytest.raises(SettingsError, match="x from 3 to 3; the MOMDP has 3"):
        AlphaVectorPolicy(momdp_of(), np.ones((1, 2)), [3], [0])


def shown(problem: bytes) -> dict[str, list[float]]:
    """Return what each (behavior, x, y) of a .pomdpx shows."""
    entries = ElementTree.fromstring(problem).iterfind("ObsFunction//Entry")
    return {entry.findtext("Instance"): [float(v) for v in entry.findtext("ProbTable").split()]
            for entry in entries}  # fmt: skip
