"""What people read stands out from its ground, on light and on dark pages (WCAG 2, AA)."""

import re
from pathlib import Path

import pytest
from matplotlib.colors import to_hex
from matplotlib.text import Text

from meal_bayes import look
from meal_bayes.look import READABLE, contrast, readable
from meal_bayes.trial_log import read_trials

ROOT = Path(__file__).resolve().parents[2]
REPORT = ROOT / "meal_bayes" / "evaluation" / "templates" / "report.html"
SITE = ROOT / "docs" / "assets" / "site.css"
PAGES = {False: ("#ffffff", "#f5f6f8"), True: ("#0d1117", "#1e2129", "#1c222a")}  # light, dark
TEXT = ("ink", "soft", "wrong", "right")  # of a report, on what follows
BEHIND = ("paper", "back", "warn")
NAMES = ("morc", "morc_itrs", "random", "random_legal", "predefined", "greedy", "bayes",
         "bayes_memory", "somebody's own")  # fmt: skip


def variables(style):
    """Read the colors of a style sheet by the names of their variables."""
    found = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{3}(?:[0-9a-f]{3})?)(?=[;\s])", style))
    return {name: "#" + "".join(2 * c for c in color[1:]) if len(color) == 4 else color
            for name, color in found.items()}  # fmt: skip


@pytest.mark.parametrize("dark", [False, True])
def test_a_report_is_read_in_both_themes(dark):
    light, _, rest = REPORT.read_text(encoding="utf-8").partition("@media (prefers-color-scheme")
    colors = variables(rest.partition("figure img")[0] if dark else light)
    assert {*TEXT, *BEHIND} <= set(colors)
    for text in TEXT:
        for behind in BEHIND:
            assert contrast(colors[text], colors[behind]) >= READABLE, (text, behind)


def test_the_site_is_read_in_both_themes():
    style = SITE.read_text(encoding="utf-8")
    primary = variables(style)["md-primary-fg-color"]
    assert contrast("#ffffff", primary) >= READABLE  # the bar's text
    links = re.findall(r'scheme="(\w+)"\] \{\s*--md-typeset-a-color: (#[0-9a-f]{6})', style)
    assert {scheme for scheme, _ in links} == {"default", "slate"}
    for scheme, color in links:
        assert contrast(color, "#1e2129" if scheme == "slate" else "#ffffff") >= READABLE


@pytest.mark.quick(1)
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("narrow", [False, True])
def test_pictures_of_trials_are_read_on_every_page(dark, narrow):
    for trial in read_trials(ROOT / "logs" / "sample.mcap"):
        figure = trial.plot(dark=dark, narrow=narrow).get_figure(root=True)
        written = [text for text in figure.findobj(Text) if text.get_visible() and text.get_text()]
        assert written
        for text in written:
            for page in PAGES[dark]:
                ratio = contrast(to_hex(text.get_color()), page)
                assert ratio >= READABLE, (text.get_text(), text.get_color(), page)


@pytest.mark.parametrize("dark", [False, True])
def test_text_has_a_readable_color_of_its_family(dark):
    colors = {*look.ATTRIBUTES, *(look.agent_style(name).color for name in NAMES)}
    for color in colors:
        for page in PAGES[dark]:
            assert contrast(readable(color, dark=dark), page) >= READABLE
    assert len({readable(color, dark=dark) for color in colors}) == len(colors)  # still told apart


@pytest.mark.parametrize("name", ["results.svg", "results-dark.svg"])
def test_numbers_of_the_results_are_read(name):
    """Letters are outlines, as are markers; no outline that is filled is fainter than text."""
    text = (ROOT / "docs" / "assets" / name).read_text(encoding="utf-8")
    groups = re.findall(r'<g style="fill: (#[0-9a-f]{6})"', text)
    assert groups
    for color in set(groups):
        for page in PAGES["dark" in name]:
            assert contrast(color, page) >= READABLE, color
