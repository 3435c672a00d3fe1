"""The page to hand over: what is on it, from the folder alone, and how a browser takes it."""

import json
import re
import shutil
import subprocess
from html.parser import HTMLParser

import numpy as np
import pytest
from PIL import Image

import cosserat_fem as cf
from cosserat_fem.cli import main
from cosserat_fem.report import write_report
from cosserat_fem.report.page import number, table

VOID = {"meta", "link", "img", "br", "hr", "path", "use"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The satellite hinge, with a picture as the drawing process would leave it."""
    place = tmp_path_factory.mktemp("run")
    assert main(["init", str(place)]) == 0
    file, folder = place / "satellite_hinge.toml", place / "seed"
    file.write_text(file.read_text().replace('every = "1 s"', 'every = "3 s"'))
    assert not cf.run_scene(cf.load_scene(file), folder).reason
    (folder / "pictures").mkdir()
    noise = np.random.default_rng(1).integers(0, 255, (800, 1280, 3), dtype=np.uint8)
    Image.fromarray(noise).save(folder / "pictures" / "stages.png")  # the worst case for its size
    write_report(folder)
    return folder


def html(folder):
    return (folder / "report.html").read_text(encoding="utf-8")


class Outline(HTMLParser):
    """Headings and cells of a page; every tag is closed in its place, no id stands twice."""

    def __init__(self, text):
        super().__init__()
        self.open, self.ids, self.headings, self.links, self._in = [], [], [], [], None
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        self.ids += [value for key, value in attrs if key == "id"]
        self.links += [
            value for key, value in attrs if key in ("src", "href", "xlink:href", "data", "action", "srcset")
        ]
        if tag not in VOID:
            self.open.append(tag)
        self._in = tag

    def handle_startendtag(self, tag, attrs):
        self.ids += [value for key, value in attrs if key == "id"]
        self.links += [value for key, value in attrs if key in ("src", "href", "xlink:href")]

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        if self._in in ("h1", "h2", "h3"):
            self.headings.append(data.strip())
            self._in = None


def test_what_is_on_it(folder):
    """Verdict first, then results, charts, pictures, data, how it was solved, how to repeat it; numbers of the summary."""
    text, summary = html(folder), json.loads((folder / "summary.json").read_text())
    outline = Outline(text)
    assert outline.headings[0] == "Satellite hinge deployment"
    order = ["Results", "Charts", "Pictures", "Hinges", "Cables", "Scene", "Solution", "Repeat this run"]
    assert [h for h in outline.headings if h in order] == order
    assert text.index('class="verdict') < text.index("<h2>Results")
    assert summary["warnings"][0].replace("'", "&#x27;") in text
    peak = summary["hinges"]["panel"]["largest_torque"]
    row = f'<td class="w">Torque at hinge panel, peak</td><td class="n">{number(peak["value"])}</td><td>N m</td>'
    assert row in text
    assert text.count("<svg ") == 3  # torque, two supports
    assert text.count('<img src="data:image/jpeg;base64,') == 1
    assert (folder / "scene.toml").read_text().splitlines()[5] in text
    assert summary["versions"]["numpy"] in text
    assert "cosserat-fem run scene.toml" in text


def test_it_is_one_small_file(folder):
    """All it needs is in it, and that is little even with a picture of noise."""
    outline = Outline(html(folder))
    assert len(outline.ids) == len(set(outline.ids))
    assert all(link.startswith(("#", "data:")) for link in outline.links)
    assert {link[1:] for link in outline.links if link.startswith("#")} <= set(outline.ids)
    assert (folder / "report.html").stat().st_size < 3_000_000
    assert "<script" not in html(folder)


def test_it_comes_from_the_folder_alone(folder, tmp_path, monkeypatch):
    """Moved, without the meshes it read, and from another directory: the same page, byte for byte."""
    first = html(folder)
    moved = tmp_path / "moved"
    shutil.copytree(folder, moved)
    (moved / "report.html").unlink()
    scene = (moved / "scene.toml").read_text()
    meshes = re.findall(r'mesh = "(.*)"', scene)
    monkeypatch.chdir(tmp_path)
    assert meshes
    assert main(["report", str(moved)]) == 0
    assert html(moved) == first


def test_charts_show_the_files(folder, tmp_path):
    """Another torque in the CSV file: another chart."""
    changed = tmp_path / "changed"
    shutil.copytree(folder, changed)
    file = changed / "hinge_torque.csv"
    lines = file.read_text().splitlines()
    column = lines[0].split(",").index("torque")
    cells = lines[20].split(",")
    lines[20] = ",".join([*cells[:column], "-100.0", *cells[column + 1 :]])
    file.write_text("\n".join(lines) + "\n")
    write_report(changed)
    assert ">−100</text>" in html(changed)
    assert ">−100</text>" not in html(folder)


def test_what_a_run_does_not_have_is_not_on_it(folder, tmp_path):
    """Without pictures there is no such chapter, a stopped run says so first, names are text and not HTML."""
    bare = tmp_path / "bare"
    shutil.copytree(folder, bare)
    shutil.rmtree(bare / "pictures")
    summary = json.loads((bare / "summary.json").read_text())
    summary |= {"title": "<b>1 & 2</b>", "status": "stopped", "reason": "t = 3 s: no equilibrium"}
    del summary["hinges"], summary["warnings"]
    (bare / "summary.json").write_text(json.dumps(summary))
    text = write_report(bare).read_text()
    outline = Outline(text)
    assert "<h1>&lt;b&gt;1 &amp; 2&lt;/b&gt;</h1>" in text
    assert {"Pictures", "Hinges", "Warnings", "Checks"}.isdisjoint(outline.headings)
    assert "Stopped early" in text
    assert "no equilibrium" in text


def test_verdicts(folder, tmp_path):
    """A verdict is the first word, each check has its line; both ends of a band stand side by side.

    Torque out and back, what lies between, work, the budget of a drive, which is judged like a check, the reduced model."""
    judged = tmp_path / "judged"
    shutil.copytree(folder, judged)
    summary = json.loads((judged / "summary.json").read_text())
    summary["verdict"] = "UNSAFE"
    check = {
        "status": "UNSAFE", "reason": "worst margin below 0", "sense": "at least", "limit": 0.024, "unit": "m",
        "worst": {"value": 0.001064, "s": 0.0, "t": 69.0}, "margin": {"value": -0.91, "s": 0.0, "t": 69.0},
    }  # fmt: skip
    summary["checks"] = {"bend radius of cable": check, "pull": check | {"status": "SAFE", "reason": "", "unit": "N"}}
    summary["band"] = {
        "of": ["cable"],
        "hinges": {"panel": {"largest_torque": {"slip": 1.25, "stick": 12.5}}},
        "checks": {"pull": {"margin": {"slip": 0.5, "stick": -0.25}}},
        "rods": {"cable": {"smallest_bend_radius": {"slip": 0.01, "stick": 1e9}}},
    }
    peak = {"value": 33.5, "angle_deg": 48.0, "t": 48.0, "error": 1e-5}
    summary["hinges"]["panel"] |= {
        "peaks": {way: {"largest": peak, "smallest": peak | {"value": -2.5}} for way in ("out", "back")},
        "band": {"largest": {"value": 0.125, "angle_deg": 64.0}, "mean": 0.0625},
        "work": {"out": 30.0, "back": -29.5, "cycle": 0.5, "friction": 0.4999},
        "drive": {
            "motorisation": 2.0, "factors": "some standard", "lines": {"cable": {"largest": 33.5, "uncertainty": 3.0}},
            "verdict": "UNSAFE", "margin": {"value": -0.25, "angle_deg": 48.0, "t": 48.0, "way": "out"},
            "required": 201.0, "available": 150.75,
        },
    }  # fmt: skip
    linear = {"stiffness": 1.5, "preload": -0.5, "coulomb": 0.05, "residual": {"largest": 0.75}}
    model = {"recommended": "table", "linear": linear, "table": {"angle": [0, 1], "residual": {"largest": 0.01}}}
    (judged / "joint_model.json").write_text(json.dumps({"about": "", "joints": {"panel": model}}))
    (judged / "summary.json").write_text(json.dumps(summary))
    text = write_report(judged).read_text()
    assert '<div class="verdict bad"><strong>✗ UNSAFE</strong>' in text
    assert "3 checks: 1 safe, 2 violated, 0 unknown. Least margin: bend radius of cable, −91.0 %." in text
    assert '<td class="n">1.064</td><td class="n">≥ 24.00</td><td>mm</td><td class="n">−91.0 %</td>' in text
    assert '<td class="n">1.250</td><td class="n">12.50</td>' in text
    assert '<td class="n">10.00</td><td class="n">straight</td>' in text
    assert '<td class="w">Margin of pull</td><td class="n">+50.0 %</td><td class="n">−25.0 %</td>' in text
    Outline(text)
    assert (
        '<td class="n">201.0</td><td class="n">≤ 150.8</td><td>N m</td><td class="n">−25.0 %</td><td>way out, 48.00°'
        in text
    )
    assert "needs at most 2 × (cable 33.50 N m × 3); factors: some standard" in text
    assert '<td class="w">panel, back: smallest torque</td><td class="n">−2.500</td>' in text
    assert '<td class="w">panel: work of a cycle</td><td class="n">0.5000</td><td>J</td>' in text
    assert "stiffness 1.500 N m/rad, preload −0.5000 N m, coulomb 0.05000 N m" in text
    assert '<td class="n">0.010</td><td>recommended</td>' in text


def test_numbers():
    cases = {
        0.0: "0", 3: "3", 33.65802: "33.66", -0.00117458: "−0.001175", 1319.18: "1319", 99999.4: "99999",
        float("nan"): "–", None: "–",
    }  # fmt: skip
    assert [number(value) for value in cases] == list(cases.values())
    assert number(2.345678e-7) == "2.346 × 10<sup>−7</sup>"
    assert "<td>&lt;1&gt;</td>" in table(["a"], [["<1>"]])


def test_faults(tmp_path, capsys):
    """No folder, another folder, a run that has not ended: one line each, exit code 2."""
    (tmp_path / "other").mkdir()
    for name, said in (("none", "there is no such folder"), ("other", "is not the folder of a run (no summary.json)")):
        assert main(["report", str(tmp_path / name)]) == 2
        assert said in capsys.readouterr().err
    (tmp_path / "other" / "scene.toml").write_text("")
    for content, said in (("[]", "is not one of a run"), ('{"status": "running", "title": ""}', "has not ended")):
        (tmp_path / "other" / "summary.json").write_text(content)
        assert main(["report", str(tmp_path / "other")]) == 2
        assert said in capsys.readouterr().err


def browse(page, tmp_path):
    """What a headless Chromium says on its console, and which addresses it was asked for, its own services apart."""
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if chromium is None:
        pytest.skip("needs chromium (on Debian: apt-get install chromium)")
    log = tmp_path / "net.json"
    command = [
        chromium, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
        "--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage",
        "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={tmp_path / 'profile'}", f"--log-net-log={log}",
        "--enable-logging=stderr", "--dump-dom", page.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", timeout=120)
    assert done.returncode == 0, done.stderr
    console = re.findall(r":CONSOLE:\d+\] (.*)", done.stderr)
    asked = set(re.findall(r'"url":"((?:https?|wss?|ftp|file)://[^"]*)"', log.read_text(errors="replace")))
    own = re.compile(r"https?://([\w.-]*\.)?(google|googleapis|gstatic)\.com/")
    return done.stdout, console, {address for address in asked if not own.match(address) and address != page.as_uri()}


def test_a_browser_takes_it(folder, tmp_path):
    """Chromium shows the page without a word on its console and asks for nothing else."""
    dom, console, asked = browse(folder / "report.html", tmp_path)
    assert dom.count("<svg ") == 3
    assert "Repeat this run" in dom
    assert console == []
    assert asked == set()


def test_the_browser_would_notice(folder, tmp_path):
    """The same with a picture from elsewhere and a script that fails, and no word that forbids them: both are seen."""
    text = re.sub("<meta http-equiv=.*\n", "", html(folder))
    planted = '<h1><img src="http://elsewhere.invalid/x.png"><script>undefined_name()</script>'
    page = tmp_path / "page.html"
    page.write_text(text.replace("<h1>", planted, 1), encoding="utf-8")
    _, console, asked = browse(page, tmp_path)
    assert asked == {"http://elsewhere.invalid/x.png"}
    assert any("undefined_name is not defined" in said for said in console)
