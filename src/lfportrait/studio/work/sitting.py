"""Heads that stay in memory, to show paintings and mixes on them at once."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from ...arrays import UInt8
from ...cache import hash_of, tried
from ...errors import UserError
from ...example import Exemplar, known_ground
from ...field import Backdrop, VoxelField, head_points
from ...files import file_state
from ...job import Session
from ...lightfield import eight_bit, render_views
from ...stylize import Painters, StyledField, StylizeConfig, load_styled
from .pictures import views_of

__all__ = ["Look", "Sitting"]

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

    Parameters
    ----------
    request
        ``job`` (folder with ``field.npz`` and ``capture/``) or ``styled`` (a painted field's file);
        with ``job`` also ``style`` (a picture or a built-in name, None for the photographed head),
        ``landmarks``, ``styles`` (of regions, by the names that the mix uses), ``pixels``.
        ``mix``: arguments of `StyledField.mix`.
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
                if style:
                    path = Path(style)
                    paths += [path, *(path.with_suffix(f".{end}") for end in
                                      ("landmarks.txt", "mask.png", "regions.png"))]
        return [(str(path), file_state(path) if path.is_file() else None) for path in paths]

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
        beside = [file_state(one) if one.is_file() else None
                  for one in (path, *(path.with_suffix(f".{end}") for end in
                                      ("landmarks.txt", "mask.png", "regions.png")))]
        saved = f"{style} {beside}"
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
        return np.concatenate([eight_bit(seen.color) for seen in render_views(
            field, views_of(field, cameras, size), background=background)], axis=1)
