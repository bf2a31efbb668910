"""Models: made, kept, merged, and what is refused."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import keygraph
import numpy as np
import pytest
from conftest import PICTURES


def test_attributes(model: keygraph.Model) -> None:
    assert model.names == ["astronaut"]
    assert [(o.name, o.width, o.height) for o in model.objects] == [("astronaut", 512, 512)]
    assert (model.preset, len(model), model.luma_only) == ("large", 1, False)
    assert model.nbytes == len(model.bytes()) == len(bytes(model)) > 1_000_000
    assert model.keypoints > 1000 and model.keygraphs > 10_000
    assert repr(model) == f"Model(astronaut, {model.nbytes} bytes)"
    assert repr(model.objects[0]) == 'ModelObject(name="astronaut", width=512, height=512)'


def test_files_and_bytes(model: keygraph.Model, tmp_path: Path) -> None:
    path = tmp_path / "m.kgm"
    model.save(path)
    assert path.read_bytes() == model.bytes()
    loaded = keygraph.Model.load(str(path))
    assert loaded == model and hash(loaded) == hash(model)
    assert loaded.preset is None, "a file does not tell"
    assert keygraph.Model(model.bytes()) == keygraph.Model(bytearray(model.bytes())) == model
    assert model != "a model"


def test_pickles_and_copies(model: keygraph.Model) -> None:
    for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1):
        again = pickle.loads(pickle.dumps(model, protocol))
        assert again == model and again.preset == "large"
    assert copy.deepcopy(model) == copy.copy(model) == model


def test_presets() -> None:
    picture = PICTURES / "coffee.jpg"
    models = {preset: keygraph.train(picture, preset=preset) for preset in ("large", "standard", "compact", "paper")}
    assert {name: model.preset for name, model in models.items()} == {name: name for name in models}
    assert models["compact"].nbytes < models["standard"].nbytes < models["large"].nbytes
    assert keygraph.train(picture, max_bytes=100_000).nbytes <= 100_000
    assert keygraph.Model(models["paper"].bytes()).preset == "paper", "the method tells"


def test_pictures_of_every_kind(compact: keygraph.Model) -> None:
    picture = keygraph.imread(PICTURES / "astronaut.jpg")
    assert keygraph.train(picture, "astronaut", "compact") == compact
    assert keygraph.train(picture[..., ::-1], "astronaut", "compact", order="bgr") == compact
    assert keygraph.train(picture.tobytes(), "astronaut", "compact", format="rgb", size=(512, 512)) == compact
    part = keygraph.train(picture, preset="compact", crop="100,50,300,350")
    assert (part.objects[0].name, part.objects[0].width, part.objects[0].height) == ("object", 300, 350)
    assert part == keygraph.train(np.ascontiguousarray(picture[50:400, 100:400]), "object", "compact")
    assert part == keygraph.train(PICTURES / "astronaut.jpg", "object", "compact", crop=(100, 50, 300, 350))


def test_packs(model: keygraph.Model, coffee: keygraph.Model, tmp_path: Path) -> None:
    coffee.save(tmp_path / "coffee.kgm")
    both = keygraph.pack([model, tmp_path / "coffee.kgm"])
    assert both.names == ["astronaut", "coffee"] and len(both) == 2
    assert both.preset is None, "the file does not tell"
    assert keygraph.pack((model, coffee)).preset == "large"
    assert keygraph.pack(model) == keygraph.pack([model]) == model
    assert keygraph.pack(iter([model, coffee])) == both
    assert both.without("astronaut") == coffee and both.without("coffee") == model
    assert keygraph.pack([both.without("astronaut"), model]).names == ["coffee", "astronaut"]
    assert both.without() == both
    with pytest.raises(ValueError, match="no object cofee: there are astronaut, coffee"):
        both.without("cofee")
    with pytest.raises(ValueError, match="no object would be left"):
        both.without("astronaut", "coffee")


def test_slim(model: keygraph.Model, coffee: keygraph.Model) -> None:
    both = keygraph.pack([model, coffee])
    slim = both.slim()
    assert slim.names == both.names and slim.nbytes < 0.5 * both.nbytes
    assert slim.slim() == slim
    with pytest.raises(ValueError, match="at least two objects"):
        model.slim()
    with pytest.raises(ValueError, match="pack the models that it was made of"):
        keygraph.pack([slim, model])


def test_what_makes_a_model_worse_is_told() -> None:
    noise = np.random.default_rng(7).integers(0, 255, (60, 60), np.uint8)
    with pytest.warns(keygraph.TrainingWarning) as told:
        keygraph.train(noise)
    said = [str(w.message) for w in told]
    assert any("no colour: trained on luma alone" in s for s in said)
    assert any("little to hold on to" in s for s in said)
    assert all(w.filename == __file__ for w in told), "the warning is of the line that called"
    framed = np.full((300, 400, 3), 255, np.uint8)
    framed[60:240, 80:320] = keygraph.imread(PICTURES / "coffee.jpg")[100:280, 100:340]
    with pytest.warns(keygraph.TrainingWarning, match=r"plain margins.*crop=80,60,240,180"):
        keygraph.train(framed)


@pytest.mark.filterwarnings("ignore::keygraph.TrainingWarning")
@pytest.mark.parametrize(
    ("given", "options", "error", "said"),
    [
        (np.full((200, 200, 3), 128, np.uint8), {}, keygraph.TrainingError, "cannot train on the picture"),
        (np.zeros((8, 8, 3), np.uint8), {}, ValueError, "8x8 is too small"),
        (np.zeros((64, 64), np.uint8), {"preset": "paper"}, keygraph.TrainingError, "no colour"),
        (PICTURES / "coffee.jpg", {"preset": "huge"}, ValueError, 'expected "large", .*, got "huge"'),
        (PICTURES / "coffee.jpg", {"max_bytes": 100}, ValueError, "bytes"),
        (PICTURES / "coffee.jpg", {"max_bytes": 1 << 40}, ValueError, "at most 67108864"),
        (PICTURES / "coffee.jpg", {"crop": (0, 0, 9999, 10)}, ValueError, "reaches beyond"),
        (np.zeros((64, 64, 3), np.uint8), {"crop": (60, 0, 10, 64)}, ValueError, r"\(60, 0, 10, 64\) leaves"),
        (PICTURES / "coffee.jpg", {"crop": (0, 0, 0, 10)}, ValueError, "above 0"),
        (PICTURES / "coffee.jpg", {"crop": 5}, TypeError, r"crop: expected \(x, y, width, height\)"),
        (PICTURES / "coffee.jpg", {"name": " "}, ValueError, "the name is empty"),
        (PICTURES / "coffee.jpg", {"name": "a\nb"}, ValueError, "control characters"),
        (PICTURES / "none.jpg", {}, FileNotFoundError, "none.jpg"),
        (3.5, {}, TypeError, "got float"),
    ],
)
def test_what_no_model_is_made_of(given: Any, options: dict[str, Any], error: type[Exception], said: str) -> None:
    with pytest.raises(error, match=said):
        keygraph.train(given, **options)


def test_damaged_models(model: keygraph.Model, tmp_path: Path) -> None:
    data = model.bytes()
    flipped = bytearray(data)
    flipped[len(data) // 2] ^= 1
    for damaged in (b"", b"no model", data[:-1], data + b"\0", bytes(flipped)):
        with pytest.raises(keygraph.ModelFileError):
            keygraph.Model(damaged)
        (tmp_path / "m.kgm").write_bytes(damaged)
        for read in (keygraph.Model.load, keygraph.Detector, keygraph.Tracker, keygraph.pack):
            with pytest.raises(keygraph.ModelFileError, match=r"m\.kgm: "):
                read(tmp_path / "m.kgm")
    with pytest.raises(TypeError):
        keygraph.Model("text")  # type: ignore[arg-type]
    with pytest.raises(FileNotFoundError, match=r"none\.kgm"):
        keygraph.Model.load("none.kgm")
    with pytest.raises(OSError, match="folder"):
        model.save(tmp_path / "no" / "folder" / "m.kgm")


def test_models_that_do_not_go_together(model: keygraph.Model) -> None:
    paper = keygraph.train(PICTURES / "coffee.jpg", preset="paper")
    with pytest.raises(keygraph.ModelFileError):
        keygraph.pack([model, paper])
    with pytest.raises(ValueError, match="at least one model"):
        keygraph.pack([])
    for wrong in (5, [5], None, [[model]], b"bytes"):
        with pytest.raises(TypeError, match=r"expected a Model, a path of a \.kgm file, or a list of them; got"):
            keygraph.Detector(wrong)  # type: ignore[arg-type]
