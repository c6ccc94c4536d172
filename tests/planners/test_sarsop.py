"""The adapter to `pomdpsol`, with programs that stand in for it: good, hanging, failing, lying."""

import os
import shutil
import stat
import sys
from pathlib import Path

import numpy as np
import pytest

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.momdp import Objective, build_momdp, initial_belief
from meal_bayes.planners import Factored, History
from meal_bayes.planners.point_based.alpha_vectors import AlphaVectorPolicy, AlphaVectors
from meal_bayes.planners.point_based.sarsop import Sarsop

HEADER = (
    '<?xml version="1.0" encoding="ISO-8859-1"?>\n<Policy version="0.1" type="value" model="m">'
)


def momdp_of(name="toy", n=1, **options):
    domain, rng = load_domain(name), np.random.default_rng(0)
    confusion = rng.dirichlet(np.ones(2), (n, len(domain.behaviors), 2))
    return build_momdp(domain, Query(domain.attributes[:n]), confusion, **options)


@pytest.fixture
def program(tmp_path):
    """Return a function that makes an executable of Python lines, which see `args`."""

    def make(*lines: str, name: str = "pomdpsol") -> Path:
        path = tmp_path / "bin" / name
        path.parent.mkdir(exist_ok=True)
        before = "import os, pathlib, subprocess, sys, time\nargs = sys.argv[1:]"
        path.write_text("\n".join([f"#!{sys.executable} -S", before, *lines]) + "\n")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        return path

    return make


def policy_text(alpha, n_x) -> str:
    """Write alpha vectors as `pomdpsol` does, six digits each."""
    shape = f'vectorLength="{alpha.vectors.shape[1]}" numObsValue="{n_x}"'
    lines = [HEADER, f'<AlphaVector {shape} numVectors="{len(alpha.x)}">']
    for vector, x, action in zip(alpha.vectors, alpha.x, alpha.action, strict=True):
        values = " ".join(f"{value:g}" for value in vector)
        lines.append(f'<Vector action="{action}" obsValue="{x}">{values} </Vector>')
    return "\n".join([*lines, "</AlphaVector> </Policy>"])


def solve(momdp, **settings):
    return Sarsop(**settings).solve(momdp, np.random.default_rng(0))


def test_a_policy_comes_back_as_it_was_written(program, tmp_path):
    momdp = momdp_of("roc36", 2, objective=Objective(abstain=True))
    rng, n_e = np.random.default_rng(0), momdp.n_behaviors
    vectors = rng.uniform(-100, 200, (3 * n_e, 4))
    alpha = AlphaVectors(vectors, np.repeat(np.arange(3), n_e), np.tile(np.arange(n_e), 3))
    ours = AlphaVectorPolicy(momdp, alpha)
    (tmp_path / "own.policy").write_text(policy_text(ours.alpha, len(momdp.x_names)))
    kept = tmp_path / "problem.pomdpx"
    path = program(
        f"pathlib.Path({str(tmp_path / 'args')!r}).write_text('\\n'.join([os.getcwd(), *args]))",
        f"text = pathlib.Path({str(tmp_path / 'own.policy')!r}).read_text()",
        "pathlib.Path(args[args.index('--output') + 1]).write_text(text)",
        f"pathlib.Path({str(kept)!r}).write_bytes(pathlib.Path(args[-1]).read_bytes())",
    )
    theirs = solve(momdp, program=path, seconds=2.5)
    folder, *arguments = (tmp_path / "args").read_text().split("\n")
    assert arguments == [
        "--timeout", "2.5", "--precision", "0.001", "--output", "out.policy", "problem.pomdpx",
    ]  # fmt: skip
    assert not Path(folder).exists()
    assert kept.read_text().startswith("<?xml")
    assert theirs.lower_bound == pytest.approx(ours.lower_bound, rel=1e-5)
    for x in range(momdp.terminal):
        history = History(initial_belief(momdp).at(x))
        one, other = (policy.decide(history, rng) for policy in (ours, theirs))
        np.testing.assert_allclose(one.values, other.values, atol=1e-2)


def test_the_program_is_found(program, monkeypatch):
    text = f'{HEADER}<AlphaVector vectorLength="2" numObsValue="3" numVectors="1">'
    write = f"pathlib.Path('out.policy').write_text({text!r} + vector + '</AlphaVector></Policy>')"

    def bounded_by(value, name):
        line = f'<Vector action="0" obsValue="0">{value} {value}</Vector>'
        return program(f"vector = {line!r}", write, name=name)

    on_path, named, given = (
        bounded_by(51, "pomdpsol"),
        bounded_by(52, "other"),
        bounded_by(53, "third"),
    )
    monkeypatch.setenv("PATH", str(on_path.parent))
    monkeypatch.delenv("MEAL_BAYES_POMDPSOL", raising=False)
    assert solve(momdp_of()).lower_bound == 51
    monkeypatch.setenv("MEAL_BAYES_POMDPSOL", str(named))
    assert solve(momdp_of()).lower_bound == 52
    monkeypatch.chdir(given.parent.parent)
    assert solve(momdp_of(), program=Path("bin/third")).lower_bound == 53


def test_no_program_is_told_with_the_way_out(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("MEAL_BAYES_POMDPSOL", raising=False)
    with pytest.raises(SettingsError, match=r"No program 'pomdpsol' here.*MEAL_BAYES_POMDPSOL"):
        solve(momdp_of())
    monkeypatch.setenv("MEAL_BAYES_POMDPSOL", str(tmp_path / "none"))
    with pytest.raises(SettingsError, match="none"):
        solve(momdp_of())


def test_a_program_that_hangs_is_ended_with_all_it_started(program, tmp_path, eventually, running):
    pids = tmp_path / "pids"
    path = program(
        "child = subprocess.Popen(['sleep', '1000'])",
        f"pathlib.Path({str(pids)!r}).write_text(f'{{os.getpid()}} {{child.pid}}')",
        "time.sleep(1000)",
    )
    with pytest.raises(SettingsError, match=r"had not ended after 1\.1 s"):
        solve(momdp_of(), program=path, seconds=0.1, patience=1.0)
    started = [int(pid) for pid in pids.read_text().split()]
    eventually(lambda: not any(map(running, started)), "programs were left running")


def test_a_program_that_fails_is_told_with_its_last_words(program):
    path = program(
        "print('x' * 5000)", "print('\\x1b[31mno memory\\n\\x00left', flush=True)", "sys.exit(3)"
    )
    with pytest.raises(
        SettingsError, match=r"ended with code 3; its output ends: .*no memory left$"
    ):
        solve(momdp_of(), program=path)


def test_a_program_that_is_none_is_told(program):
    path = program()
    path.write_bytes(b"\x00\x01\x02")
    with pytest.raises(SettingsError, match="cannot be run"):
        solve(momdp_of(), program=path)


@pytest.mark.parametrize(
    ("line", "kind", "found"),
    [
        ("pass", SettingsError, "wrote no policy; its output ends: none"),
        ("os.symlink('/dev/zero', 'out.policy')", SettingsError, "wrote no policy"),
        ("pathlib.Path('out.policy').write_bytes(os.urandom(4000))", DataError, "is no policy"),
        ("pathlib.Path('out.policy').write_text('')", DataError, "is no policy"),
        (
            "pathlib.Path('out.policy').write_text('<!DOCTYPE a><Policy/>')",
            DataError,
            "declares a document type",
        ),
        (
            "pathlib.Path('out.policy').write_text('<Policy><AlphaVector vectorLength=\"3\" "
            'numObsValue="1" numVectors="1"><Vector action="0" obsValue="0">1 2 3</Vector>'
            "</AlphaVector></Policy>')",
            DataError,
            "wrote a policy that does not fit: Alpha vectors of 3 values",
        ),
    ],
)  # fmt: skip
def test_a_policy_that_is_none_is_told(program, line, kind, found):
    with pytest.raises(kind, match=found):
        solve(momdp_of(), program=program(line))


def test_what_the_format_cannot_hold_is_told(program):
    path = program("sys.exit(1)")
    for momdp, found in (
        (momdp_of(precision=4.0), "precision=inf"),
        (momdp_of(objective=Objective(discount=1.0)), "discount below 1"),
        (momdp_of("ispy32", 9), "9 attributes"),
    ):
        with pytest.raises(SettingsError, match=found):
            solve(momdp, program=path)


@pytest.mark.parametrize("abstain", [False, True])
def test_illegal_behaviors_are_priced_below_every_report(program, tmp_path, abstain):
    momdp, kept = momdp_of("toy", objective=Objective(abstain=abstain)), tmp_path / "kept"
    path = program(f"pathlib.Path({str(kept)!r}).write_text(pathlib.Path(args[-1]).read_text())")
    with pytest.raises(SettingsError, match="wrote no policy"):
        solve(momdp, program=path)
    prices = [float(part.split("<")[0]) for part in kept.read_text().split("<ValueTable>")[1:]]
    assert min(prices) < momdp.incorrect
    assert (" abstain<" in kept.read_text()) is abstain


@pytest.mark.parametrize("change", [{"seconds": 0}, {"precision": -1}, {"patience": float("inf")}])
def test_settings_out_of_range_are_told(change):
    with pytest.raises(SettingsError, match="Sarsop needs"):
        Sarsop(**change)


def test_the_real_program_agrees():
    """Runs where SARSOP is installed: its bound on a small problem is ours."""
    program = os.environ.get("MEAL_BAYES_POMDPSOL") or shutil.which("pomdpsol")
    if program is None:
        pytest.skip("no pomdpsol here; set MEAL_BAYES_POMDPSOL to compare with it")
    momdp = momdp_of("toy", 2, objective=Objective(abstain=True))
    ours = Factored().solve(momdp, np.random.default_rng(0)).upper_bound
    assert ours - 0.5 < solve(momdp, program=program).lower_bound < ours
