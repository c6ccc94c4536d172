"""Small folders in the layouts of the data sets, to be read and to be broken."""

import json

import pytest

DOMAIN = """
name = "own"
data = "{data}"
attributes = {attributes}
behaviors = [{behaviors}]
[diagram]
states = ["x0"]
start = "x0"
effects = [{effects}]
"""


def write_domain(path, data, attributes, contexts):
    rows = [f'{{name="{n}", cost=1.0, modalities={json.dumps(m)}}}' for n, m in contexts]
    effects = [f'{{from="x0", do="{n}", to="x0"}}' for n, _ in contexts]
    names = {"data": data, "attributes": json.dumps(attributes)}
    text = DOMAIN.format(**names, behaviors=", ".join(rows), effects=", ".join(effects))
    path.write_text(text, encoding="utf-8")


@pytest.fixture
def files(tmp_path):
    """Write one's own data: 2 objects, 2 recordings, look_color (2 features), lift_haptics (1)."""
    contexts = [("look", ("color",)), ("lift", ("haptics",))]
    write_domain(tmp_path / "own.toml", "own", ["red", "heavy"], contexts)
    (tmp_path / "labels.csv").write_text("object,heavy,red\ncup,0,1\nstone,1,\n")
    (tmp_path / "look_color.csv").write_text(
        "object,recording,r,g\ncup,1,0.5,1\ncup,2,0.25,2\nstone,1,3,4\nstone,2,-1e-3,5\n"
    )
    (tmp_path / "lift_haptics.csv").write_text(
        "object,recording,force\nstone,2,9\ncup,1,1\nstone,1,8\ncup,2,2\n"
    )
    return tmp_path


@pytest.fixture
def cy101(tmp_path):
    """Write a CY101 of three objects in the published layout, with its quirks."""
    write_domain(
        tmp_path / "own.toml",
        "cy101",
        ["soft", "can", "stuffed animal"],
        [("look", ("color",)), ("tap", ("flow",))],
    )
    folder = tmp_path / "normalized_data_without_noobject"
    folder.mkdir()
    (tmp_path / "objects.txt").write_text("ball_t\nno_object\ncan\nbear\n")
    (tmp_path / "cy101_labels.csv").write_text(
        'object,words\nball_t,"soft, round"\nbear,"stuffed animal,  soft"\n'
        'can,"can, hard, can"\nno_object,'
    )
    rows = [f"{o}_t{k},{10 * i + k},7" for i, o in enumerate(("ball_t", "can", "bear"))
            for k in range(1, 6)]  # fmt: skip
    rows[3] = "ball_t_t4,-2147483519,7"
    rows[6] = rows[5].replace("can_t1", "can_t2")
    (folder / "look_color.txt").write_text("\n".join(reversed(rows)))
    (folder / "tap_flow.txt").write_text("\n".join(r.split(",")[0] + ",0" for r in rows) + "\n")
    return tmp_path


@pytest.fixture
def ispy32(tmp_path):
    """Write an ISPY32 of two objects in the published layout."""
    write_domain(tmp_path / "own.toml", "ispy32", ["light", "heavy"], [("look", ("rgb",))])
    (tmp_path / "corl_features").mkdir()
    (tmp_path / "object_list.csv").write_text("white_water_bottle_full,1\npineapple_cup,2\n")
    (tmp_path / "labels.csv").write_text("predicate,1,2\nheavy,1.0,-1.0\nodd,1.0,0.0\n")
    rows = [f"{o},{k},{o}.5,{k}" for k in (3, 1, 5, 4, 2) for o in (2, 1)]
    (tmp_path / "corl_features" / "look_rgb.txt").write_text("\n".join(rows))
    return tmp_path


@pytest.fixture
def roc36(tmp_path):
    """Write a ROC36 of two objects in the published layout."""
    attributes = ["light", "heavy", "brown", "rice", "beans"]
    write_domain(tmp_path / "own.toml", "roc36", attributes, [("look", ("patch",))])
    (tmp_path / "sensorimotor_features").mkdir()
    (tmp_path / "objects.txt").write_text("light_brown_rice\nheavy_blue_beans\n")
    rows = [f"{name},{i},{k}" for k in range(10)
            for i, name in enumerate(("light_brown_rice", "heavy_blue_beans"))]  # fmt: skip
    (tmp_path / "sensorimotor_features" / "look-patch.txt").write_text("\n".join(rows) + "\n")
    return tmp_path


@pytest.fixture
def change():
    """Replace text in a file that must hold it exactly once."""

    def replace(path, old, new):
        text = path.read_bytes().decode()
        assert text.count(old) == 1
        path.write_bytes(text.replace(old, new).encode("utf-8", "surrogateescape"))

    return replace
