"""Make the site of what lies beside docs/, draw equations, and find examples in docstrings.

MkDocs calls the functions that start with `on_`. `Examples` is an extension of griffe, which reads
the docstrings.
"""

import ast
import html
import posixpath
import re
from collections import Counter
from pathlib import Path
from typing import Any

import griffe
from latex2mathml.converter import convert
from mkdocs.exceptions import BuildError
from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
BESIDE = ("*.md", "benchmarks/README.md", "paper_repro/*.md", "paper_repro/results/*.md",
          "paper_repro/results/*.png")  # fmt: skip
# Who searches a word wants what it means before who decided it and where it was measured; a page's
# own head may say otherwise.
BOOSTS = {"concepts/": 2.0, "results/": 0.5, "decisions.md": 0.5, "paper_repro/": 0.5,
          "benchmarks/": 0.5, "CHANGELOG.md": 0.5}  # fmt: skip
HEADING = "    options: { show_root_heading: true, show_root_full_path: false }"
FUNCTIONS = {  # functions that a package takes from modules as a whole
    "meal_bayes.trial_log": f"\n::: meal_bayes.trial_log.file.salvage\n{HEADING}\n",
    "meal_bayes.planners": f"\n::: meal_bayes.planners.precompile.warm_up\n{HEADING}\n",
}
LINK = re.compile(r"\]\((?!\w+:|#)([^)\s]+)")
CODE = re.compile(r"<code>[^<]*</code>")
OPTION = re.compile(r"(?<![\w-])--\w[\w-]*")  # of a command, which browsers would break after "--"
EQUATION = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)


def packages() -> dict[str, Path]:
    """Return the packages with public names, by name."""
    sources = sorted((ROOT / "meal_bayes").rglob("__init__.py"))
    return {
        ".".join(path.parent.relative_to(ROOT).parts): path
        for path in sources
        if "__all__" in path.read_text("utf-8")
    }


def public_names(source: Path) -> list[str]:
    """Read `__all__` of a package."""
    (names,) = re.findall(r"^__all__ = (\[.*?\])", source.read_text("utf-8"), re.M | re.S)
    return list(ast.literal_eval(names))


def on_config(config: Any) -> Any:
    """Put a page for each package behind the first page of the reference."""
    (pages,) = (entry["Reference"] for entry in config.nav if "Reference" in entry)
    pages[1:1] = [{name: f"reference/{name}.md"} for name in packages()]
    return config


def on_files(files: Files, config: Any) -> Files:
    """Add pages of packages, and what lies outside of docs/, under the paths that it has."""
    guides = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *ROOT.glob("examples/*.py")]
    mentions = Counter(re.findall(r"\w+", "".join(path.read_text("utf-8") for path in guides)))
    for package, source in packages().items():
        # What people are told to call comes first.
        names = sorted(public_names(source), key=lambda name: (-mentions[name], name))
        options = f"    options: {{ members: [{', '.join(names)}] }}"
        text = f"# {package}\n\n::: {package}\n{options}\n{FUNCTIONS.get(package, '')}"
        files.append(File.generated(config, f"reference/{package}.md", content=text))
    for pattern in BESIDE:
        for path in sorted(ROOT.glob(pattern)):
            name = path.relative_to(ROOT).as_posix()
            if name != "README.md":
                files.append(File.generated(config, name, abs_src_path=str(path)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Turn links between files of the repository into links between pages of the site."""
    here = page.file.src_uri
    boosts = [boost for place, boost in BOOSTS.items() if here.startswith(place)]
    page.meta.setdefault("search", {"boost": boosts[0]} if boosts else {})
    if here.startswith("reference/"):
        return markdown + (package_table() if here.endswith("index.md") else "")
    source = here if (ROOT / here).is_file() else f"docs/{here}"

    def link(found: re.Match[str]) -> str:
        path = posixpath.normpath(posixpath.join(posixpath.dirname(source), found[1]))
        return "](" + posixpath.relpath(path.removeprefix("docs/"), posixpath.dirname(here) or ".")

    return LINK.sub(link, markdown)


def package_table() -> str:
    """Make the table of packages, by the first lines of their docstrings."""
    texts = {n: ast.get_docstring(ast.parse(p.read_text("utf-8"))) for n, p in packages().items()}
    rows = [f"| [`{n}`]({n}.md) | {str(text).splitlines()[0]} |" for n, text in texts.items()]
    return "\n".join(["\n| package | |", "|---|---|", *rows, ""])


def on_page_content(content: str, **_: Any) -> str:
    """Turn equations into MathML, which browsers draw without any script; keep options whole."""
    whole = CODE.sub(
        lambda found: OPTION.sub(r'<span class="option">\g<0></span>', found[0]), content
    )
    return EQUATION.sub(mathml, whole)


def mathml(found: re.Match[str]) -> str:
    """Return the MathML of one equation."""
    _, bracket, latex = found.groups()
    return str(convert(html.unescape(latex), display="block" if bracket == "[" else "inline"))


def on_post_build(config: Any) -> None:
    """Check that every public name stands on the page of its package.

    Raises
    ------
    BuildError : names that do not.
    """
    absent = []
    for package, source in packages().items():
        page = Path(config.site_dir, "reference", package, "index.html").read_text("utf-8")
        shown = set(re.findall(rf'id="{re.escape(package)}\.(?:\w+\.)?(\w+)"', page))
        absent += [f"{package}.{name}" for name in public_names(source) if name not in shown]
    if absent:
        raise BuildError(f"No page shows {', '.join(absent)}.")


class Examples(griffe.Extension):
    """Put doctests into the section of a docstring where griffe looks for them."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Write the heading of the section before the first doctest."""
        if obj.docstring is not None and "Examples\n---" not in obj.docstring.value:
            text = obj.docstring.value
            obj.docstring.value = re.sub(
                r"^>>>", "Examples\n--------\n>>>", text, count=1, flags=re.MULTILINE
            )

    def on_package(self, *, pkg: griffe.Module, **_: Any) -> None:
        """Do the same for the package itself."""
        self.on_object(obj=pkg)
