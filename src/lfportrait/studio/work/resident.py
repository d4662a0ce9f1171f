"""The process that answers at once: previews, viewers, faces, regions, what an eye sees.

Heads stay in memory (`Sitting`), to show paintings and mixes on them at once.
"""

import time
import warnings
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from ... import lightfield, models
from ...arrays import Float64, UInt8
from ...cache import hash_of, tried
from ...color import to_uint8
from ...errors import UserError
from ...example import Exemplar, known_ground
from ...face import GENERIC_LANDMARKS, detect_faces, write_landmarks
from ...field import Backdrop, VoxelField, head_points
from ...files import atomic_path, file_state, image_bytes, write_image, write_json
from ...job import FAIR, GOOD, Session, check_style, chosen_face
from ...labels import BY_HAND
from ...lightfield import DepthReport, Display, EncodeConfig, ViewMask, pattern
from ...lightfield.screens import Bridge
from ...media.pictures import read_image
from ...runner import serve as serve_requests
from ...share import OpenPage, PageConfig, recolored, write_page
from ...stylize import Painters, StyledField, StylizeConfig, load_styled
from ..answers import read_error
from ..styles import file_states, sources, write_picture
from .pictures import views_of

Value = TypeVar("Value")


class _Kept(Generic[Value]):
    """The things that were used last, by their keys."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._things: OrderedDict[str, Value] = OrderedDict()

    def get(self, key: str, make: Callable[[], Value]) -> Value:
        """A thing, made where it is not there."""
        if key not in self._things:
            # Made before an older one is let go: the new one may need its parts.
            self._things[key] = make()
        self._things.move_to_end(key)
        while len(self._things) > self._most:
            self._things.popitem(last=False)
        return self._things[key]


class _Few(Painters):
    """Painters of few paintings: they share the memory with jobs."""

    MOST = 3


class Look:
    """What is shown: a sitter in a style and a mix.

    A request has ``job`` (folder with ``field.npz`` and ``capture/``) or ``styled`` (a painted
    field's file); with ``job`` also ``style`` (a picture or a built-in name, None for the
    photographed head), ``landmarks``, ``styles`` (of regions, by the names that the mix uses),
    ``pixels``. ``mix``: arguments of `StyledField.mix`.
    """

    def __init__(self, request: Mapping[str, Any]) -> None:
        self.job = Path(request["job"]) if request.get("job") else None
        self.styled = Path(request["styled"]) if request.get("styled") else None
        self.style: str | None = request.get("style")
        self.landmarks: Sequence[Sequence[float]] | None = request.get("landmarks")
        self.others: dict[str, str] = dict(request.get("styles") or {})
        self.pixels: float | None = request.get("pixels")
        self.mix: dict[str, Any] = dict(request.get("mix") or {})

    def _stamps(self) -> list[tuple[str, tuple[int, ...] | None]]:
        """All files that it depends on, with their times."""
        paths: list[Path] = []
        if self.styled is not None:
            paths = [self.styled]
        elif self.job is not None:
            paths = [self.job / "field.npz", self.job / "capture" / "transforms.json"]
            for style in (self.style, *self.others.values()):
                paths += sources(Path(style)) if style else []
        return [*zip(map(str, paths), file_states(paths))]

    def painted_key(self) -> str:
        """Changes with whatever the painted head depends on."""
        points = None if self.landmarks is None else np.asarray(self.landmarks, float).tolist()
        return hash_of(str(self.job), str(self.styled), self.style, sorted(self.others.items()),
                       points, self.pixels, self._stamps())[:32]

    def key(self) -> str:
        """Changes with whatever is shown, the mix included."""
        return hash_of(self.painted_key(), sorted(self.mix.items(), key=lambda one: one[0]))[:32]


class Sitting:
    """The heads, paintings and painted heads that are in memory."""

    def __init__(self) -> None:
        self._sessions: _Kept[Session] = _Kept(2)
        self._painted: _Kept[VoxelField] = _Kept(4)
        self._mixed: _Kept[VoxelField] = _Kept(2)
        self._exemplars: _Kept[Exemplar] = _Kept(12)
        self._grounds: _Kept[Backdrop] = _Kept(2)
        # With landmarks that are moved at this moment: the next ones are others.
        self._tried: _Kept[VoxelField] = _Kept(1)

    def session(self, job: Path) -> Session:
        """A head with all that previews need."""
        key = f"{job} {file_state(job / 'field.npz')}"
        return self._sessions.get(key, lambda: Session(job / "field.npz", job / "capture",
                                                       painters=_Few()))

    def exemplar(self, style: str, landmarks: Any = None) -> Exemplar:
        """A painting, with landmarks that may not be saved yet."""
        path = Path(style)
        saved = f"{style} {file_states(sources(path))}"
        if landmarks is None:
            return self._exemplars.get(saved, lambda: Exemplar.load(style))
        points = np.asarray(landmarks, np.float64)

        def moved() -> Exemplar:
            if not path.is_file():
                return replace(self.exemplar(style), landmarks=points)
            # Read once: the picture is the same, and no face must be found in it.
            base = self._exemplars.get(f"{saved} picture", lambda: Exemplar.load(path, points))
            return replace(base, landmarks=points)

        return moved()

    def field(self, look: Look) -> VoxelField:
        """What is shown."""
        kept = self._painted if look.landmarks is None else self._tried
        base = kept.get(look.painted_key(), lambda: self._made(look))
        if not look.mix:
            return base
        if not isinstance(base, StyledField):
            raise UserError("the photographed head has no painting to mix with")
        styled = base
        return self._mixed.get(look.key(), lambda: styled.mix(**look.mix))

    def on_panel(self, look: Look) -> VoxelField:
        """What is shown, with the painted ground behind it, which a preview is made without."""
        field = self.field(look)
        if look.job is None or look.style is None or field.backdrop is not None:
            return field
        session, exemplar = self.session(look.job), self.exemplar(look.style, look.landmarks)
        backdrop = self._grounds.get(look.painted_key(), lambda: Backdrop(
            *known_ground(exemplar, seed=session.config.seed), head_points(field)))
        # The field itself stays as it is: its page has no ground.
        grounded = replace(field, backdrop=backdrop)
        grounded.take_layouts(field)
        return grounded

    def _made(self, look: Look) -> VoxelField:
        """The painted head, at full strength."""
        if look.styled is not None:
            return load_styled(look.styled)
        assert look.job is not None
        session = self.session(look.job)
        if look.style is None:
            return session.field
        config = session.config if look.pixels is None else StylizeConfig(pixels=look.pixels)
        exemplars = [self.exemplar(look.style, look.landmarks),
                     *(replace(self.exemplar(path), name=name)
                       for name, path in look.others.items())]
        if look.landmarks is not None and len(exemplars) == 1:
            with tried():  # the next landmarks are others: the user's cache need not keep these
                return session.preview(exemplars[0], config, keep=False)
        if len(exemplars) == 1:
            return session.preview(exemplars[0], config)
        return session.preview_all(exemplars, config)

    def picture(self, look: Look, cameras: Sequence[tuple[float, float, float]], size: int,
                background: float = 1.0) -> UInt8:
        """What is shown from some cameras, side by side: uint8 [size, size * cameras, 3]."""
        field = self.field(look)
        return np.concatenate([lightfield.eight_bit(seen.color) for seen in lightfield.render_views(
            field, views_of(field, cameras, size), background=background)], axis=1)


Facts = Mapping[str, Any]
_NOSE = 30  # Its tip among the 68.


def usual_face(place: tuple[float, float], width: int, height: int) -> Float64:
    """Landmarks of a usual face, float64 [68, 2], with the tip of its nose at a place (x, y).

    They are to be corrected by hand. The face takes two fifths of the picture's shorter side, or
    less near the border, and lies in the picture as far as the place allows it.
    """
    nose = np.clip(place, 0, [width - 1, height - 1])
    face = (GENERIC_LANDMARKS[:, :2] - GENERIC_LANDMARKS[_NOSE, :2]) * [1, -1]
    reach = np.array([-face.min(0), face.max(0)])
    room = np.array([nose, [width - 1, height - 1] - nose]) / reach
    scale = 0.4 * min(width, height) / np.ptp(face[:, 1])
    points: Float64 = nose + face * max(min(scale, room.min()), 0.25 * scale)
    return points


_QUALITY = 88  # Of JPEGs.
_BRIDGE = 3.0  # Seconds that Bridge has to answer.


class _Resident:
    """What the process knows; each public method answers a question."""

    def __init__(self) -> None:
        self.sitting = Sitting()
        self._coded: tuple[str, UInt8] | None = None

    def preview(self, facts: Facts) -> dict[str, Any]:
        begun, look = time.perf_counter(), Look(facts["look"])
        image = self.sitting.picture(look, facts["cameras"], int(facts["size"]))
        data = image_bytes(image, "JPEG", quality=_QUALITY)
        if facts.get("keep"):
            with atomic_path(facts["keep"]) as temporary:
                temporary.write_bytes(data)
        return {"picture": data, "key": look.key(), "seconds": time.perf_counter() - begun}

    def warm(self, facts: Facts) -> dict[str, Any]:
        """Read a head before it is asked for."""
        session = self.sitting.session(Path(facts["job"]))
        session.skin(float(facts.get("pixels") or session.config.pixels))
        return {}

    def viewer(self, facts: Facts) -> dict[str, Any]:
        """Write the page of a look, for an iframe; what is in it."""
        look = Look(facts["look"])
        target = Path(facts["folder"]) / f"{look.key()}.html"
        beside = target.with_suffix(".json")
        if not (target.is_file() and beside.is_file()):
            field = self.sitting.field(look)
            figures = write_page(field, target, PageConfig(title=facts.get("title", "")))
            about: dict[str, Any] = {"sets": figures["sets"], "styles": [], "regions": []}
            if isinstance(field, StyledField):
                about |= {"styles": list(field.styles), "regions": list(field.regions)}
            write_json(beside, about)
        return {"key": look.key()}

    def colors(self, facts: Facts) -> dict[str, Any]:
        """Further color sets for a page that is open."""
        page = OpenPage.of(Path(facts["page"]).read_bytes())
        sets = [recolored(page, self.sitting.field(Look(look))) for look in facts["looks"]]
        return {"sets": None if None in sets else sets}

    def _placed(self, facts: Facts) -> tuple[Any, Display, EncodeConfig]:
        field = self.sitting.on_panel(Look(facts["look"]))
        panel = Display.resolve(facts["display"])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the report says it
            placed = lightfield.composed(field, panel, EncodeConfig(**facts["placement"]))
        return field, panel, placed

    def budget(self, facts: Facts) -> dict[str, Any]:
        """The panel's depth budget for a head as it is placed."""
        _, panel, config = self._placed(facts)
        report = DepthReport.of(panel, config)
        return {"lines": report.lines(), "figures": report.figures(),
                "sharp": [report.back if np.isfinite(report.back) else None, report.front],
                "head": [report.head_back, report.head_front],
                "placement": {name: getattr(config, name) for name in (
                    "size", "shift_x", "shift_y", "focus", "depth_scale")}}

    def coded(self, facts: Facts) -> UInt8:
        """A look, coded for a panel; the last one is kept."""
        look = Look(facts["look"])
        field, panel, config = self._placed(facts)
        key = repr((look.key(), panel, config))
        if self._coded is None or self._coded[0] != key:
            self._coded = key, lightfield.encode(field, panel, config, mask=ViewMask.build(panel))
        return self._coded[1]

    def eye(self, facts: Facts) -> dict[str, Any]:
        """What an eye in front of the panel sees, JPEG."""
        image, panel = self.coded(facts), Display.resolve(facts["display"])
        block = max(1, round(panel.width / int(facts["width"])))
        seen = lightfield.simulate(image, panel, facts["eye"], crosstalk=facts["crosstalk"],
                                   block=block)
        return {"picture": image_bytes(to_uint8(seen), "JPEG", quality=_QUALITY)}

    def full(self, facts: Facts) -> dict[str, Any]:
        panel = Display.resolve(facts["display"])
        lightfield.write_coded(Path(facts["file"]), self.coded(facts), panel)
        return {}

    def pattern(self, facts: Facts) -> dict[str, Any]:
        panel = Display.resolve(facts["display"])
        lightfield.write_coded(Path(facts["file"]), pattern(panel, facts["kind"]), panel)
        return {}

    def bridge(self, facts: Facts) -> dict[str, Any]:
        """The displays that Looking Glass Bridge on this machine reports."""
        try:
            with Bridge(timeout=_BRIDGE) as bridge:
                version = bridge.version()
                devices = [one for one in bridge.devices() if one.looking_glass]
        except UserError as error:
            return {"running": False, "version": "", "displays": [], "message": str(error)}
        return {"running": True, "version": version, "message": "", "displays": [
            {"index": one.index, "name": one.name, "display": asdict(one.display())}
            for one in devices]}

    def cast(self, facts: Facts) -> dict[str, Any]:
        path = Path(facts["file"])
        layout = lightfield.layout_of_file(path)
        if layout is None:
            raise UserError(f"{path.name} is no quilt; export the version as a quilt first")
        with Bridge(timeout=_BRIDGE) as bridge:
            device = bridge.device(int(facts["screen"]))
            bridge.cast(path, layout, screen=device.index)
        return {"ok": True, "screen": device.index}

    def style_picture(self, facts: Facts) -> dict[str, Any]:
        """Write the picture of a built-in style."""
        image = self.sitting.exemplar(str(facts["style"])).image
        write_picture(image, int(facts["size"]), Path(facts["file"]))
        return {}

    def faces(self, facts: Facts) -> dict[str, Any]:
        """All faces of a picture, kept in a file."""
        path = Path(facts["style"])
        if path.is_file():
            image = np.ascontiguousarray(read_image(path)[..., :3])
            if not models.available("face-landmarker"):  # all points are set by hand
                return {"width": image.shape[1], "height": image.shape[0], "faces": []}
            found = detect_faces(image)
        else:
            exemplar = self.sitting.exemplar(str(path))
            image, found = exemplar.image, [exemplar.landmarks]
        data = {"width": image.shape[1], "height": image.shape[0],
                "faces": [np.round(points, 2).tolist() for points in found]}
        write_json(facts["file"], data)
        return data

    def choose(self, facts: Facts) -> dict[str, Any]:
        """Write the landmarks of the face that is meant beside the painting."""
        path = Path(facts["style"])
        image = np.ascontiguousarray(read_image(path)[..., :3])
        at = facts.get("at")
        if at is None:
            points, _ = chosen_face(path, image, int(facts.get("face", 0)))
        else:
            place = float(at[0]), float(at[1])
            try:
                points, _ = chosen_face(path, image, 0, place)
            except UserError:  # not even there: then all points are set by hand, from a usual face
                points = usual_face(place, image.shape[1], image.shape[0])
        write_landmarks(path.with_suffix(".landmarks.txt"), points)
        return {"points": points.tolist()}

    def check_style(self, facts: Facts) -> dict[str, Any]:
        """What a painting will give, without a preview."""
        found = check_style(facts["style"], preview=False)
        return {"facts": [{"grade": "good" if color == GOOD else "fair" if color == FAIR else "bad",
                           "text": text} for color, text in found.facts],
                "pose": found.figures["pose"], "face_pixels": found.figures["face_pixels"]}

    def regions(self, facts: Facts) -> dict[str, Any]:
        """Write what the detectors see in a painting as a picture of regions."""
        style = facts["style"]
        path = Path(style)
        exemplar = self.sitting.exemplar(style)
        if path.is_file():
            # Without what was painted over by hand.
            exemplar = Exemplar(exemplar.image, exemplar.landmarks, exemplar.name)
        regions = exemplar.regions()
        value = {name: number for number, name in enumerate(BY_HAND)}
        picture = np.full(exemplar.image.shape[:2], value["background"], np.uint8)
        person = regions.person > 0.5
        picture[person] = value["skin"]
        height, width = exemplar.image.shape[:2]
        _, down = regions.frame.local((height, width))
        picture[person & (down > 1.02)] = value["neck"]
        if regions.hair is not None:
            picture[person & (regions.hair > 0.5)] = value["hair"]
        write_image(facts["file"], picture)
        return {"width": width, "height": height}

    def copy_style(self, facts: Facts) -> dict[str, Any]:
        """Copy a style as a picture with its landmarks beside it."""
        exemplar = self.sitting.exemplar(facts["style"])
        target = Path(facts["file"])
        write_image(target, exemplar.image)
        write_landmarks(target.with_suffix(".landmarks.txt"), exemplar.landmarks)
        if exemplar.mask is not None:
            write_image(target.with_suffix(".mask.png"), exemplar.mask)
        return {}


def serve() -> None:
    """Answer questions, each the name of a method and facts."""
    resident = _Resident()
    serve_requests(lambda question, _: getattr(resident, question[0])(question[1]), read_error)
