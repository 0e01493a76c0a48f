"""The page of models without an option, beside a viewer of the web."""

from __future__ import annotations

import io
import json
import urllib.error
import urllib.request
from functools import partial
from http.server import ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from benchmarks import look_page
from benchmarks.__main__ import app
from benchmarks.look_seconds import seconds_report
from benchmarks.peers import model_viewer
from glpath import GlpathError


def png(*colour: int) -> bytes:
    found = io.BytesIO()
    Image.new("RGBA", (8, 8), colour).save(found, "PNG")
    return found.getvalue()


def test_a_page_has_each_model_with_both_pictures_and_what_was_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("b.glb", "a.gltf", "notes.txt"):
        (tmp_path / name).write_text("")
    models = look_page.models_in(tmp_path)
    assert [path.name for path in models] == ["a.gltf", "b.glb"]
    ours = {"a.gltf": look_page.Rendered(png(255, 0, 0, 255), 1.5, "no light, <so>"), "b.glb": None}
    monkeypatch.setattr(
        look_page, "_rendered", lambda path, side: ours[path.name] or look_page.Rendered(b"", 2.0, "error: broken")
    )
    theirs = [model_viewer.Shown(png(0, 0, 255, 0), 0.25), model_viewer.Shown(error="no <picture>")]
    monkeypatch.setattr(look_page, "shown_by_model_viewer", lambda paths, side: theirs)
    rendered = look_page.render_models(models, tmp_path / "out", 8, lambda text: None)
    page = look_page.write_page(models, rendered, tmp_path / "out", 8)
    text = page.read_text()
    for part in ("glpath, 1.5 s", "model-viewer, 0.2 s", "no light, &lt;so&gt;", "no &lt;picture&gt;", "broken"):
        assert part in text
    assert (page.parent / "a.gltf.glpath.png").read_bytes() == png(255, 0, 0, 255)
    sheet = np.asarray(Image.open(page.parent / "sheet.jpg")).astype(int)
    left, right = sheet[6, 6], sheet[6, 172]
    assert left[0] > 200 > 60 > left[2]
    assert right.min() > 240, "what is transparent is over white"


def test_seconds_are_a_report_without_paths(tmp_path: Path) -> None:
    for name in ("A", "B"):
        path = tmp_path / "Models" / name / "glTF" / f"{name}.gltf"
        path.parent.mkdir(parents=True)
        path.write_text("{}")
    models = look_page.models_in(tmp_path)
    assert [path.stem for path in models] == ["A", "B"]
    rendered = [look_page.Rendered(b"png", 7.0, "", 11.0), look_page.Rendered(b"png", 6.0, "", 12.0)]
    report = seconds_report(models, rendered, 512)
    assert report.holds
    assert (report.measured["seconds_max"], report.measured["processor_seconds_max"]) == (7.0, 12.0)
    assert report.rows[1] == {"model": "B", "seconds": 6.0, "processor_seconds": 12.0}
    assert str(tmp_path) not in report.as_json()
    assert not seconds_report(models, [rendered[0], look_page.Rendered(b"png", 8.1, "")], 512).holds
    assert not seconds_report(models, [rendered[0], look_page.Rendered(b"", 1.0, "")], 512).holds
    assert seconds_report(models, rendered, 64).holds is None


def test_the_server_has_the_model_and_what_lies_beside_it_and_takes_pictures(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    (tmp_path / "models" / "a.gltf").write_text("model")
    (tmp_path / "models" / "a.bin").write_text("beside")
    (tmp_path / "secret").write_text("secret")
    answers = model_viewer._Answers()
    handler = partial(
        model_viewer._Handler,
        page=b"page",
        package=tmp_path / "models",
        models=[tmp_path / "models" / "a.gltf"],
        answers=answers,
    )
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        at = f"http://127.0.0.1:{server.server_address[1]}"
        opener = urllib.request.build_opener(urllib.request.ProxyHandler({}))

        def get(path: str) -> bytes:
            with opener.open(at + path) as answer:
                return bytes(answer.read())

        assert (get("/"), get("/models/0/a.gltf"), get("/models/0/a.bin")) == (b"page", b"model", b"beside")
        for path in ("/models/0/../secret", "/models/0/%2e%2e/secret", "/secret"):
            try:
                assert get(path) != b"secret"
            except urllib.error.HTTPError as error:
                error.close()
        body = json.dumps({"seconds": 0.5, "picture": "data:image/png;base64,QUJD"}).encode()
        opener.open(urllib.request.Request(f"{at}/shown/0", body)).close()
        server.shutdown()
    assert answers.found == {0: model_viewer.Shown(b"ABC", 0.5)}
    assert answers.wait_for(1, 0.0)
    assert not answers.wait_for(2, 0.0)


def test_what_is_missing_is_named_before_anything_is_rendered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("NODE_PATH", str(tmp_path))
    with pytest.raises(GlpathError, match="@google/model-viewer") as missing:
        model_viewer.package()
    assert "npm install" in missing.value.remedy
    for arguments, message in ((["nowhere"], "is no folder"), ([str(tmp_path)], "has no model")):
        result = CliRunner().invoke(app, ["look", *arguments])
        assert result.exit_code == 2
        assert message in " ".join(result.output.split())
