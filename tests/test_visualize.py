"""Images, videos and reports: tests of their content; their looks are checked by eye."""

import base64
import html
import re
import subprocess
import sys
from dataclasses import fields, replace
from itertools import combinations

import cv2
import matplotlib
import numpy as np
import pytest
from matplotlib import pyplot

import nsdr.visualize
from nsdr import DataError, Event, Executor, Scene, SceneObject, read_world, save
from nsdr.clevrer.example import VIDEO
from nsdr.cli.main import main
from nsdr.io.video import read_video
from nsdr.pipeline import Perception, Pipeline
from nsdr.symbolic.causal import direct_causes
from nsdr.tracking.tracker import TrackerConfig, rows_of
from nsdr.types import LAWS, DynamicsPrediction, Judgement, Rollout, Violation
from nsdr.visualize import annotated_image, stroboscopic_image, write_report
from nsdr.visualize.annotate import write_image
from nsdr.visualize.figures import figure_png, new_figure, plan_figure
from nsdr.visualize.html_parts import thumbnail
from nsdr.visualize.violations import JudgedVideo, judged_video, judgement_html, write_judgements
from nsdr.world.camera import CLEVRER_CAMERA
from nsdr.world.vocabulary import CLEVRER


@pytest.fixture(scope="module")
def perceived(perception: Perception):
    return read_video(VIDEO), perception


def test_names_are_loaded_when_first_used() -> None:
    code = "import nsdr.visualize, sys; sys.exit(any(m in sys.modules for m in ('torch', 'cv2', 'matplotlib')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
    for name in nsdr.visualize.__all__:
        assert getattr(nsdr.visualize, name).__doc__, name


def test_stroboscopic_image_shows_earlier_positions(perceived) -> None:
    frames, p = perceived
    image = stroboscopic_image(frames, p.proposals, p.tracks)
    assert image.shape == (640, 960, 3)
    last = cv2.resize(frames[-1], (960, 640), interpolation=cv2.INTER_CUBIC)
    changed = np.abs(image.astype(int) - last.astype(int)).max(-1) > 12
    mover = max(p.tracks.tracks, key=lambda t: float(np.ptp(t.centroid_px, axis=0).max()))
    x, y = (2 * mover.centroid_px[np.flatnonzero(mover.frame_index % 12 == 127 % 12)[1]]).astype(int)
    assert changed[y - 8 : y + 8, x - 8 : x + 8].any()


def test_annotated_image_without_proposals_has_no_outlines(perceived) -> None:
    frames, p = perceived
    full, bare = (annotated_image(frames[60], 60, proposals, p.tracks, p.scene) for proposals in (p.proposals, None))
    assert full.shape == bare.shape == (640, 960, 3)
    assert (full != bare).any()


def test_images_are_written_to_new_folders(perceived, tmp_path) -> None:
    image = perceived[0][0]
    write_image(tmp_path / "new" / "first.png", image)
    assert (cv2.imread(str(tmp_path / "new" / "first.png"), cv2.IMREAD_COLOR_RGB) == image).all()
    with pytest.raises(DataError, match=r"last\.txt: cannot write an image; expected a name ending in \.png or \.jpg"):
        write_image(tmp_path / "last.txt", image)


def test_report_shows_the_stages_that_there_are(perceived, tmp_path) -> None:
    _, p = perceived
    write_report(tmp_path / "report.html", None, Perception(None, None, None, p.scene), [])
    page = (tmp_path / "report.html").read_text()
    assert "<video" not in page
    assert "Without each object" not in page
    entered = next(e.frame for e in p.scene.events if e.kind == "in")  # about frame 25
    assert f"<b>frame {entered}</b>the purple metal cube enters" in page


def test_report_shows_each_stretch_of_motion(perceived, tmp_path) -> None:
    scene = perceived[1].scene
    moving = np.zeros_like(scene.moving)
    moving[0, [3, 4, 5, 20]] = True
    visible = scene.visible.copy()
    visible[0, :22] = True
    write_report(
        tmp_path / "r.html", None, Perception(None, None, None, replace(scene, moving=moving, visible=visible)), []
    )
    page = (tmp_path / "r.html").read_text()
    assert "<title>moves: frames 3\u20135</title>" in page
    assert "<title>moves: frames 20\u201320</title>" in page


def test_report_has_a_video_objects_events_and_collapsed_numbered_steps(perceived, tmp_path) -> None:
    frames, p = perceived
    executor = Executor(p.scene)
    program = "events objects purple filter_color unique filter_collision unique get_frame"
    spheres = [
        ("the cyan one", "objects cyan filter_color unique"),
        ("the sphere", "objects sphere filter_shape unique"),
    ]
    question = "events events objects cyan filter_color unique filter_out unique filter_ancestor belong_to"
    answers = [
        executor.answer(program, "When?"),
        executor.answer_choices(question, spheres, "Which?"),
        executor.answer("unseen_events"),
    ]
    write_report(tmp_path / "report.html", frames, p, answers)
    page = (tmp_path / "report.html").read_text()
    assert "<video controls loop muted src='data:video/mp4;base64," in page
    assert re.search(r"purple metal cube</text><rect [^>]+ fill='rgb\(129,38,192\)'", page)
    assert "prefers-color-scheme: dark" in page
    assert re.search(r"Answer: <b>frame \d+</b> \((&gt;99|\d+) %\)", page)
    assert "'the sphere' in choice B fits two objects" in html.unescape(page)
    tables = re.findall(r"<details><summary>(\d+) steps</summary><table>(.*?)</table>", page)
    assert len(tables) == 3
    for count, table in tables:
        assert re.findall(r"<tr><td class=number>(\d+)", table) == [str(i + 1) for i in range(int(count))]
    assert "<code>filter_color</code> (2, purple)" in tables[0][1]
    assert "://" not in page  # self-contained
    events = [*p.scene.events, *p.scene.predicted]
    assert page.count("<g class=event") == len(events)
    causes = sum(len(found) for found in direct_causes(events))
    assert page.count("<path class=cause ") == causes > 0
    first = next(e for e in p.scene.events if e.kind == "collision")
    assert (
        f"const v=document.querySelector('#video video');if(v){{v.pause();v.currentTime={(first.frame + 0.5) / 25:.2f}"
        in page
    )
    assert page.count("<h3>Without the ") == len(p.scene.objects)
    gone = re.search(r"<h3>Without the brown metal cylinder</h3>(.*?)<h3>", page)[1]
    assert gone.startswith("<img alt='from above' src='data:image/jpeg")
    assert f"<li>no longer: the brown metal cylinder and the cyan metal sphere collide (frame {first.frame}" in gone


def test_report_says_why_each_choice_is_wrong(perceived, tmp_path) -> None:
    _, p = perceived
    choices = [("the purple cube", "objects purple filter_color unique")]
    program = "events events objects cyan filter_color unique filter_out unique filter_ancestor belong_to"
    answer = Executor(p.scene).answer_choices(program, choices, "Which of these is responsible?")
    write_report(tmp_path / "report.html", None, p, [answer])
    table = (tmp_path / "report.html").read_text().partition("<table>")[2].partition("</table>")[0]
    assert "<tr class=wrong>" in table
    assert "The purple cube is not responsible for the exit of the cyan sphere" in table


def test_report_of_a_video_with_one_object_and_of_a_scene_with_none(perceived, tmp_path) -> None:
    """Nothing is left without a single object, so the report has no such part."""
    _, p = perceived
    rows = rows_of(max(p.tracks.tracks, key=lambda t: len(t.frame_index)), p.proposals)
    columns = ("frame_index", "attribute", "score", "centroid_px", "area_px", "box_xyxy_px")
    kept = {name: getattr(p.proposals, name)[rows] for name in columns}
    proposals = replace(p.proposals, **kept, masks=tuple(p.proposals.masks[i] for i in rows))
    one = Pipeline.from_pretrained().perceive(proposals=proposals)
    assert len(one.scene.objects) == 1
    answer = Executor(one.scene).answer("objects count", "How many objects are there?")
    write_report(tmp_path / "one.html", perceived[0], one, [answer])
    page = (tmp_path / "one.html").read_text()
    assert "Answer: <b>1</b>" in page
    assert "Without" not in page
    nothing = Scene((), 128, np.zeros((0, 128), bool), np.zeros((0, 128), bool), ())
    write_report(tmp_path / "none.html", None, Perception(None, None, None, nothing), [])
    assert "Without" not in (tmp_path / "none.html").read_text()


def test_plan_shows_all_objects_and_collisions_with_their_names() -> None:
    objects = tuple(SceneObject(i, color, "metal", "cube") for i, color in enumerate(CLEVRER.words["color"][:6]))
    places = [(0, 0), (0.05, 0.3), (0.1, -0.3), (5.5, 0), (-6, 1), (0, 7.5)]
    location = np.tile(np.array(places, float)[:, None], (1, 60, 1))
    collisions = (Event("collision", 20, (0, 1)), Event("collision", 22, (0, 2)))
    rollout = Rollout(location, np.ones((6, 60), bool), collisions)
    figure = plan_figure(DynamicsPrediction(objects, 60, rollout))
    (axes,) = figure.axes
    low, high = np.array([axes.get_xlim(), axes.get_ylim()]).T
    for x, y in places:
        assert (low < (y, -x)).all()
        assert ((y, -x) < high).all()
    names = [*(f"{o.id} {o.name}" for o in objects), "1: frame 20", "2: frame 22"]
    assert [text.get_text() for text in figure.legends[0].texts] == names
    assert [text.get_text() for text in axes.texts] == ["1", "2"]
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in (*figure.legends[0].texts, *axes.texts)]
    assert not any(a.overlaps(b) for a, b in combinations(boxes, 2))
    assert not any(box.overlaps(axes.bbox) for box in boxes[:8])
    figure_png(figure)


def test_plan_shows_as_seen_only_what_is_in_the_image() -> None:
    """An object that enters at frame 40 and leaves at frame 50; its motion is known in all frames."""
    o = SceneObject(0, "red", "metal", "cube")
    location = np.stack([np.zeros(80), np.linspace(-3, 3, 80)], -1)[None]
    visible = np.zeros((1, 80), bool)
    visible[0, 40:50] = True
    figure = plan_figure(DynamicsPrediction((o,), 60, Rollout(location, visible, ())))
    lines = [line for line in figure.axes[0].lines if line.get_marker() == "None"]
    solid, dashed = (np.flatnonzero(np.isfinite(line.get_xdata())) for line in lines)
    assert solid.tolist() == list(range(40, 50))
    assert dashed.tolist() == [*range(41), *range(49, 80)]
    figure_png(figure)


def test_plan_shows_boxes_with_their_edges_and_headings() -> None:
    blocks, yaw = read_world("blocks"), np.linspace(0, np.pi / 6, 60)[None]
    o = SceneObject(0, "pink", "metal", "brick")
    rollout = Rollout(np.zeros((1, 60, 2)), np.ones((1, 60), bool), (), yaw=yaw)
    figure = plan_figure(DynamicsPrediction((o,), 60, rollout, world=blocks))
    (corners,) = [p.get_xy()[:-1] for p in figure.axes[0].patches if p.get_zorder() == 4]
    edges = np.diff(corners, axis=0)
    assert np.sort(np.linalg.norm(edges, axis=1))[::2] == pytest.approx([0.3, 0.6])
    longest = max(
        edges, key=np.linalg.norm
    )  # along the x axis, which is up in the plan, and turned towards y, the right
    assert abs(np.arctan2(*longest)) % np.pi == pytest.approx(np.pi / 6)
    figure_png(figure)


@pytest.mark.filterwarnings("ignore:.*CLEVRER's videos have 128")
def test_several_pictures_of_one_perception(short_video, tmp_path, capsys, monkeypatch) -> None:
    calls = []
    perceive = Pipeline.perceive
    monkeypatch.setattr(Pipeline, "perceive", lambda self, video: calls.append(video) or perceive(self, video))
    names = ("image.png", "annotated.mp4", "report.html")
    outputs = [argument for name in names for argument in ("-o", str(tmp_path / "new" / name))]
    question = ["-q", "How many collisions happen?"]
    assert main(["visualize", str(short_video), *question, "--image", "all", *outputs]) == 0
    assert len(calls) == 1
    images = [f"image_{image}.png" for image in ("strobe", "last", "plan")]
    assert capsys.readouterr().out.splitlines() == [str(tmp_path / "new" / n) for n in (*images, *names[1:])]
    for image in images:
        assert cv2.imread(str(tmp_path / "new" / image)).std() > 5
    video = cv2.VideoCapture(str(tmp_path / "new" / "annotated.mp4"))
    size = [video.get(k) for k in (cv2.CAP_PROP_FRAME_COUNT, cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)]
    assert size == [48, 960, 640]
    page = (tmp_path / "new" / "report.html").read_text()
    for text in (question[1], "events objects filter_collision count", "program tree", "Without each object"):
        assert text in page


def test_pictures_of_a_saved_scene(perceived, tmp_path, capsys) -> None:
    _, p = perceived
    scene, bare, plan, page = (tmp_path / name for name in ("scene.json", "bare.json", "plan.png", "report.html"))
    save(scene, replace(p.scene, dynamics=p.explanation.prediction))
    save(bare, p.scene)
    assert main(["visualize", str(scene), "--image", "all", "-o", str(plan), "-o", str(page)]) == 0
    assert [f.name for f in tmp_path.glob("*.png")] == ["plan_plan.png"]
    assert "Without each object" in page.read_text()
    assert main(["visualize", str(bare), "-o", str(page)]) == 0
    assert main(["visualize", str(bare), "-o", str(plan)]) == 2
    assert "holds no trajectories for --image plan; make it again with nsdr parse" in capsys.readouterr().err
    assert main(["visualize", str(scene), "-o", str(tmp_path / "a.mp4")]) == 2
    assert "is a saved scene, which has no frames for mp4; give the video" in capsys.readouterr().err
    assert main(["visualize", str(scene), "--dynamics", "propnet", "-o", str(plan)]) == 2
    assert "is a saved scene: --dynamics would do nothing" in capsys.readouterr().err


@pytest.mark.filterwarnings("ignore:.*CLEVRER's videos have 128")
def test_errors_say_what_is_wrong(short_video, tmp_path, capsys) -> None:
    assert main(["visualize", str(VIDEO), "-o", "a.gif"]) == 2
    assert "ending in .png or .mp4 or .html" in capsys.readouterr().err
    assert (
        main(["visualize", str(short_video), "--image", "plan", "--removed", "9", "-o", str(tmp_path / "a.png")]) == 2
    )
    assert "--removed 9: the objects are 0 to" in capsys.readouterr().err


def judgement_of(p, probability: float, *violations: Violation) -> Judgement:
    return Judgement(tuple(t.object for t in p.tracks.tracks), 128, violations, probability)


def test_violations_are_marked_in_the_timeline_and_shown_in_frames(perceived) -> None:
    frames, p = perceived
    one = Violation("solidity", (0, 2), 20, 30, 0.314, "world units", 0.9)
    other = Violation("arrow", (0, 1), 0, 128, 960.4, "nats", 0.7)
    page = judgement_html(judgement_of(p, 0.97, one, other), p.tracks, frames, "#tracks video")
    names = [t.object.name for t in p.tracks.tracks]
    text = f"frame 20: solidity, the {names[0]} and the {names[2]} (0.31 world units from centre to centre, 90 %)"
    assert f"<title>{text}</title>" in page
    assert "frame 0: arrow, all objects (backwards it fits better by 960 nats, 70 %)" in page
    assert [int(f) for f in re.findall(r"<b>frame (\d+)</b>", page)] == [12, 20, 28, 0, 64, 127]
    assert LAWS["solidity"] in page
    assert page.count("<path class=broken") == 4
    assert re.search(r"<rect class=broken x=255.9 \S+ width=43.0 ", page)  # ten of 128 frames, on 550 units
    assert page.count("v.currentTime=0.82") == 2  # the mark and the line of frame 20
    assert re.findall(r"data-violation=(\d)( open)?>", page) == [("0", " open"), ("1", "")]
    alone = judgement_html(judgement_of(p, 0.97, one, other), p.tracks, frames)
    assert "currentTime" not in alone
    assert alone.count(" open>") == 2


def test_judged_videos_are_reported_worst_first(perceived, tmp_path) -> None:
    _, p = perceived
    bad = Violation("inertia", (0,), 20, 30, 0.3, "world units/s", 0.8)
    worse = [replace(bad, probability=0.9), replace(bad, law="friction", frame=60)]
    videos = [
        JudgedVideo("lawful.mp4", judgement_of(p, 0.1)),
        JudgedVideo("bad.mp4", judgement_of(p, 0.8, bad), "first"),
        JudgedVideo("<b>.mp4", None, "no <video>"),
        JudgedVideo("worse.mp4", judgement_of(p, 0.95, *worse), "second"),
    ]
    write_judgements(tmp_path / "report.html", videos)
    page = (tmp_path / "report.html").read_text()
    assert "<h1>2 of 3 judged videos break a law</h1><p>inertia 2, friction 1</p>" in page
    parts = ["<h2>worse.mp4</h2>second", "<h2>bad.mp4</h2>first", "No law broken", "lawful.mp4", "Not judged"]
    assert sorted(parts, key=page.index) == parts
    assert "<td>lawful.mp4<td>6 objects in 128 frames. Probability that a law is broken: 10 %" in page
    assert "<td>&lt;b&gt;.mp4<td>no &lt;video&gt;" in page


def test_report_of_judged_videos_holds_the_videos_within_a_limit(perceived, tmp_path) -> None:
    """The second one is noise, which cannot be compressed, and much longer than a clip."""
    frames, p = perceived
    noise = np.random.default_rng(0).integers(0, 255, (600, 160, 240, 3), np.uint8)

    class Judged:
        tracker, camera = TrackerConfig(), CLEVRER_CAMERA

        def frames(self, path, beyond_cuts, note):
            return iter(frames if path == "video" else noise)

        def proposals(self, path):
            return p.proposals, None

    bad = judgement_of(p, 0.9, Violation("inertia", (0,), 20, 30, 0.3, "world units/s", 0.8))
    row = {f.name: getattr(bad, f.name) for f in fields(bad)}
    shown = [judged_video(Judged(), row | {"video": name}).shown for name in ("video", "noise")]
    videos = [re.findall(r"<video controls loop muted src='data:video/mp4;base64,([^']+)'", one) for one in shown]
    for (video,), n_frames in zip(videos, (128, 300), strict=True):
        (tmp_path / "video.mp4").write_bytes(base64.b64decode(video))
        assert (tmp_path / "video.mp4").stat().st_size <= 2_000_000
        read = cv2.VideoCapture(str(tmp_path / "video.mp4"))
        assert read.get(cv2.CAP_PROP_FRAME_COUNT) == n_frames
        seconds = n_frames / read.get(cv2.CAP_PROP_FPS)
        assert seconds == pytest.approx(n_frames / 25 * (1 if n_frames == 128 else 2))
    players = [re.search(r"<div id=(\S+)><video", one)[1] for one in shown]
    assert players[0] != players[1]
    assert f"querySelector('#{players[0]} video')" in shown[0]


def test_a_box_is_thin_where_its_object_is_not_seen(perceived) -> None:
    frames, p = perceived
    late = max(p.tracks.tracks, key=lambda t: int(t.frame_index[0]))
    f = int(late.frame_index[0])
    assert f > 0
    seen, hidden = (thumbnail(frames[f], index, p.tracks, [late.object.id]) for index in (f, f - 1))
    assert seen != hidden
    assert hidden != thumbnail(frames[f], f, p.tracks, [])


def test_figures_leave_the_users_matplotlib_alone() -> None:
    before = matplotlib.get_backend(), pyplot.get_fignums()
    matplotlib.use("pdf")
    assert figure_png(new_figure(4, 3)).startswith(b"\x89PNG")
    assert (matplotlib.get_backend(), pyplot.get_fignums()) == ("pdf", before[1])
    matplotlib.use(before[0])
