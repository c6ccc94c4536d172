"""Make the pictures of README and site from the sample log, and the sample log itself.

    python benchmarks/picture.py             docs/assets/trial*.svg from logs/sample.mcap
    python benchmarks/picture.py --viewer    docs/viewer*.png too
    python benchmarks/picture.py --log       logs/sample.mcap anew, then the pictures of the trial

The picture of the viewer needs a Vulkan driver, which may be one in software: on Debian and Ubuntu
`apt-get install --no-install-recommends mesa-vulkan-drivers`.
"""

import argparse
import io
import tempfile
from itertools import product
from pathlib import Path

from PIL import Image

from meal_bayes.learner import ask
from meal_bayes.look import save
from meal_bayes.trial_log import read_header, read_trials, write_trials
from meal_bayes.viewer import take_picture, write_recording

ROOT = Path(__file__).resolve().parents[1]
LOG = ROOT / "logs" / "sample.mcap"
VIEWER = ROOT / "docs" / "viewer.png"
NARROW = ROOT / "docs" / "viewer-narrow.png"  # for phones: its columns below each other
WINDOW = (1280, 720)
COLUMNS = ((0, 66, 384, 690), (384, 66, 682, 314), (682, 66, 1080, 314))  # texts and two plots
PICTURES = ROOT / "docs" / "assets"
QUESTIONS = (  # the first is the one that is shown
    ("Is it heavy, and does it hold beans?", "heavy_blue_beans"),
    ("Is it blue?", "light_blue_glass"),
    ("Is it medium, brown, and does it hold screws?", "light_brown_screws"),
    ("Is it green, and does it hold rice?", "heavy_green_rice"),
    ("Is it light?", "medium_brown_rice"),
)
SHOWN = 0  # trial
COLORS = 256


def make_log(path: Path) -> None:
    """Ask a few questions of one agent and log the trials."""
    asked = {"dataset": "roc36", "agent": "bayes", "seed": 0}
    trials = [ask(question, object=name, **asked) for question, name in QUESTIONS]
    config = {"command": "sample", **asked, "questions": [question for question, _ in QUESTIONS]}
    write_trials(path, trials, header={"config": config, "seed": asked["seed"]}, overwrite=True)
    print(f"{path}: {len(trials)} trials, {path.stat().st_size:,} bytes")


def draw_trial(log: Path, folder: Path) -> list[Path]:
    """Draw the trial for wide and for narrow columns, on light and on dark pages."""
    trial = list(read_trials(log))[SHOWN]
    paths = []
    for narrow, dark in product((False, True), repeat=2):
        name = "trial" + ("-narrow" if narrow else "") + ("-dark" if dark else "")
        paths.append(save(trial.plot(dark=dark, narrow=narrow), folder / f"{name}.svg"))
    return paths


def take_viewer_pictures(log: Path) -> None:
    """Show the last behavior before the answer, in a window and in one column."""
    trial = list(read_trials(log))[SHOWN]
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "sample.rrd"
        write_recording(read_trials(log), recording, read_header(log), name=log.name, only=SHOWN)
        data = take_picture(recording, row=len(trial.steps) - 1, size=WINDOW)
    picture = Image.open(io.BytesIO(data)).convert("RGB")
    parts = [picture.crop(box) for box in COLUMNS]
    column = Image.new("RGB", (max(p.width for p in parts), sum(p.height for p in parts)))
    top = 0
    for part in parts:
        column.paste(part, (0, top))
        top += part.height
    for image, path in ((picture, VIEWER), (column, NARROW)):
        image.quantize(COLORS).save(path, optimize=True)
        print(f"{path}: {path.stat().st_size:,} bytes")


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--log", action="store_true", help="make the sample log anew")
    parser.add_argument("--viewer", action="store_true", help="take the pictures of the viewer too")
    options = parser.parse_args()
    if options.log:
        make_log(LOG)
    for path in draw_trial(LOG, PICTURES):
        print(f"{path}: {path.stat().st_size:,} bytes")
    if options.viewer:
        take_viewer_pictures(LOG)


if __name__ == "__main__":
    main()
