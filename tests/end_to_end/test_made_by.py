"""Which blocks of measured numbers are old: those that other code or data made."""

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CODE = '''"""A module."""
def halved(x):
    """Return the half."""  # it is
    if x < 0:
        raise ValueError(f"{x} is below 0")
    return x / 2
'''
TABLE = "[costs]\nlook = 0.5\n"


@pytest.fixture
def readme(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    sys.modules.pop("readme", None)
    import readme  # noqa: PLC0415  a script that imports its siblings

    return readme


@pytest.fixture
def made(readme, tmp_path):
    """Return what computes the digest of a project of two files, with some of them replaced."""

    def of(command="meal-bayes run", **files):
        root = tmp_path / str(len(list(tmp_path.iterdir())))
        contents = {
            "posterior/grid.py": CODE,
            "domain/toy.toml": TABLE,
            "cli/run.py": CODE,
            **files,
        }
        for name, text in contents.items():
            path = root / "meal_bayes" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")
        return readme.made_by(command, root)

    return of


def test_a_changed_function_setting_or_table_is_seen(made):
    first = made()
    assert len(first) == 12
    for files in (
        {"posterior/grid.py": CODE.replace("x / 2", "x / 3")},
        {"posterior/grid.py": CODE.replace("x < 0", "x <= 0")},
        {"domain/toy.toml": TABLE.replace("0.5", "0.6")},
        {"posterior/new.py": "x = 1"},
    ):
        assert made(**files) != first
    assert made("meal-bayes run --seed 1") != first


def test_a_changed_comment_docstring_message_or_page_is_not(made):
    first = made()
    for files in (
        {"posterior/grid.py": CODE.replace("# it is", "# of x")},
        {"posterior/grid.py": CODE.replace("Return the half", "Halve")},
        {"posterior/grid.py": CODE.replace("is below 0", "is negative")},
        {"posterior/grid.py": CODE.replace("x / 2", "(x /\n        2)")},
        {"domain/toy.toml": "# costs, s\n" + TABLE},
        {"cli/run.py": "x = 1"},
    ):
        assert made(**files) == first


def test_a_block_that_other_code_made_fails_a_release_and_is_named(readme, monkeypatch, capsys):
    monkeypatch.setattr(readme, "check_demo", lambda: 0)
    code = readme.kept()[readme.CODE]
    monkeypatch.setattr(readme, "made_by", code.__getitem__)
    assert readme.check(release=True) == 0
    monkeypatch.setattr(readme, "made_by", {**code, readme.BELIEFS: "changed"}.__getitem__)
    capsys.readouterr()
    assert readme.check(release=False) == 0
    assert readme.check(release=True) == 1
    (listed, _) = capsys.readouterr().out.splitlines()
    assert "docs/results/beliefs.md, block beliefs" in listed
    assert "python benchmarks/readme.py --only beliefs" in listed


def test_a_block_that_is_not_what_was_measured_fails_every_check(readme, monkeypatch, capsys):
    monkeypatch.setattr(readme, "check_demo", lambda: 0)
    monkeypatch.setattr(readme, "is_old", lambda _: False)
    rows = readme.kept()
    rows[readme.BELIEFS][0]["nll"] += 1
    monkeypatch.setattr(readme, "kept", lambda: rows)
    assert readme.check(release=False) == 1
    assert "block beliefs" in capsys.readouterr().out
