"""Pieces of a mesh file become one skin: a page for each texture, and colours where there is none."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from varos_warp.errors import InputError
from varos_warp.files import is_file
from varos_warp.scene.geometry.files.holes import may_cut
from varos_warp.scene.geometry.files.pieces import FileMaterial, MeshFile, Piece, Texture
from varos_warp.scene.geometry.files.wavefront import shown
from varos_warp.scene.geometry.parts import Page, Skin
from varos_warp.scene.images import Picture, read_picture

GREY = 0.5
"""Reflectance of what a file has no colour for, as that of a part without material."""
FAR_UV = 16.0
"""Coordinates beyond are moved by whole repeats of the texture, so that single precision holds them."""
FARTHEST_UV = 1e9
"""Coordinates beyond are refused: double precision leaves them less than a thousand places within a texel of 16384."""


class Skins:
    """Makes the skin of a file; notes what it finds wrong in the file's notes."""

    def __init__(self, file: MeshFile, key: str | None):
        self.file, self.key = file, key
        self.pages: list[Page] = []
        self.constant: tuple[str, ...] = ()
        """Names of the textures that are one colour throughout."""
        self._numbers: dict[FileMaterial, int] = {}
        self._pictures: dict[tuple, Picture | None] = {}

    def made(self) -> tuple[list[Piece], Skin | None]:
        """The pieces that are to be seen, and their skin; None if the file has no colours at all."""
        pieces = [piece for piece in self.file.pieces if not _vanishes(piece)]
        if all(piece.material is None and piece.colours is None for piece in pieces):
            return pieces, None
        parts = [self._piece(piece) for piece in pieces]
        corners, pages, tints = zip(*parts, strict=True)
        if not self.pages:
            if not any(values.any() for values in corners):
                self.file.note("its materials make it black all over: give it a material, if that is not meant")
            return pieces, Skin(np.concatenate(corners))
        plain = [np.ones((len(c), 3, 4), np.float32) for c in corners]
        tinted = any(tint is not None for tint in tints)
        tints = [white if tint is None else tint for tint, white in zip(tints, plain, strict=True)]
        tints = np.concatenate(tints) if tinted else None
        numbers = np.concatenate([np.full(len(c), page, np.int32) for c, page in zip(corners, pages, strict=True)])
        values = np.concatenate([c if c.shape[-1] == 3 else np.pad(c, ((0, 0), (0, 0), (0, 1))) for c in corners])
        only = len(self.pages) == 1 and not numbers.any()
        cut = np.zeros(len(values), bool)
        for k, page in enumerate(self.pages):
            if page.masks:
                self.pages[k] = self._cut_by(page, np.flatnonzero(numbers == k), values, tints, cut)
        return pieces, Skin(
            values[..., :2] if only else values,
            tuple(self.pages),
            None if only else numbers,
            tints,
            cut if cut.any() else None,
        )

    def _cut_by(self, page, faces, values, tints, cut) -> Page:
        """A page that masks; without its mask if that cuts nothing. Marks those of its faces that it may cut."""
        fade = None if tints is None else tints[faces][..., 3]
        cut[faces] = may_cut(page, values[faces][..., :2], fade)
        return page if cut[faces].any() else replace(page, alpha=None, cutoff=0.0)

    def _piece(self, piece):
        """Corner values [F, 3, 2 or 3], page (-1: none) and tints [F, 3, 4] or None of a piece."""
        piece = self._without_lost_picture(piece)
        material = piece.material if self.file.colours_multiply else self._only_colours_of_vertices(piece)
        fades = (
            material is not None
            and material.cutoff is not None
            and piece.colours is not None
            and (piece.colours.shape[-1] == 4)
        )
        if material is not None and (material.texture is not None or fades):
            page = self._page(material)
            if page >= 0:
                uv = np.zeros((len(piece.faces), 3, 2)) if piece.uv is None else piece.uv
                uv = near_zero(uv, self.pages[page].wrap).astype(np.float32)
                return uv, page, self._tints_on(material.texture, piece.colours)
        if material is not None and material.texture is not None and piece.colours is None:
            return _flat(piece, (GREY,) * 3), -1, None
        base = (GREY,) * 3 if material is None and piece.colours is None else (1.0,) * 3
        colour = base if material is None else material.base
        if material is not None and material.texture is not None and not self.file.colours_multiply:
            colour = (1.0,) * 3  # its picture is not there
        if piece.colours is None:
            return _flat(piece, colour), -1, None
        return (piece.colours[..., :3] * np.float32(colour)).astype(np.float32), -1, None

    def _without_lost_picture(self, piece) -> Piece:
        """The piece; grey, or as its vertices are, and still cut by its mask, if only its picture is not there."""
        texture = None if piece.material is None else piece.material.texture
        if texture is None or texture.mask is None or not _is_lost(texture.source):
            return piece
        self._note_lost(texture)
        base = (GREY if piece.colours is None else 1.0,) * 3
        return replace(piece, material=replace(piece.material, base=base, texture=replace(texture, source=None)))

    def _note_lost(self, texture):
        self.file.note(f"{texture.name} is not there ({shown(texture.source.name)}): what it colours is grey")

    def _only_colours_of_vertices(self, piece) -> FileMaterial | None:
        """The material of a piece; without its colour if vertices have theirs, which is told where it changes them."""
        material = piece.material
        if material is None or piece.colours is None or (material.texture and material.texture.source is not None):
            return material
        if material.base != (1.0, 1.0, 1.0):
            self.file.note("colours of its vertices go before those of its materials")
        return replace(material, base=(1.0, 1.0, 1.0))

    def _tints_on(self, texture, colours):
        """Factors [F, 3, 4] of a texture: the colours of vertices, if the format has it so; else they are left out."""
        if colours is None or texture is None or texture.source is None or self.file.colours_multiply:
            return _tints(colours)
        if (colours[..., :3] != 1.0).any():
            self.file.note("its textures go before the colours of its vertices")
        return None

    def _page(self, material) -> int:
        """Number of the page of a material; -1 if its picture is missing."""
        if material not in self._numbers:
            picture = Picture.plain() if material.texture is None else self._picture(material.texture)
            self._numbers[material] = -1 if picture is None else len(self.pages)
            if picture is not None:
                self.pages.append(_page_of(material, picture))
        return self._numbers[material]

    def _picture(self, texture) -> Picture | None:
        """The picture of a texture; None, with a note, if there is no such file."""
        key = texture.source, texture.mask  # however it is wrapped
        if key not in self._pictures:
            self._pictures[key] = self._read(texture)
            if (picture := self._pictures[key]) is not None and picture.is_constant:
                self.constant += (texture.name,)
        return self._pictures[key]

    def _read(self, texture):
        key = f"{self.key}: {self.file.path.name}" if self.key else self.file.path.name
        source, mask, key = texture.source, texture.mask, f"{key}: {texture.name}"
        if _is_lost(source):
            self._note_lost(texture)
            return None
        picture = Picture.plain() if source is None else read_picture(source, key)
        if mask is not None and not is_file(mask.path):
            self.file.note(f"the mask of {texture.name} is not there ({shown(mask.path.name)}): it cuts no holes")
            return Picture(picture.texels)
        return picture if mask is None else Picture(picture.texels, _alpha_of(mask, key))


def _is_lost(source) -> bool:
    """Return whether a texture is a file that is not there."""
    return isinstance(source, Path) and not is_file(source)


def _alpha_of(mask, key) -> np.ndarray:
    """Alpha uint8 [H, W] that a mask says."""
    return 255 - _channel_of(mask, key) if mask.inverted else _channel_of(mask, key)


def _channel_of(mask, key) -> np.ndarray:
    """The channel uint8 [H, W] that a mask names, or which it has."""
    picture = read_picture(mask.path, key)
    alpha = np.full((1, 1), 255, np.uint8) if picture.alpha is None else picture.alpha
    if mask.channel == "m" or (not mask.channel and alpha.min() < 255):
        return alpha
    if mask.channel in ("r", "g", "b"):
        return np.ascontiguousarray(picture.texels[..., "rgb".index(mask.channel)])
    brightness = read_picture(mask.path, key, mask.path).alpha
    assert brightness is not None  # that of the mask
    return brightness


def _vanishes(piece) -> bool:
    """Return whether a mask leaves nothing of a piece, whose alpha is one number."""
    m = piece.material
    return m is not None and m.cutoff is not None and m.alpha < m.cutoff


def _page_of(material, picture) -> Page:
    masked = material.cutoff is not None and material.cutoff > 0.0
    wrap = ("repeat", "repeat") if material.texture is None else material.texture.wrap
    if not masked:
        return Page(picture.texels, material.base, wrap)
    alpha = np.full((1, 1), 255, np.uint8) if picture.alpha is None else picture.alpha
    return Page(picture.texels, material.base, wrap, alpha, material.cutoff / material.alpha)


def _flat(piece, colour):
    return np.broadcast_to(np.float32(colour), (len(piece.faces), 3, 3)).copy()


def _tints(colours):
    """Colours of corners as factors [F, 3, 4] of a texture; None without colours."""
    if colours is None or colours.shape[-1] == 4:
        return colours
    return np.concatenate([colours, np.ones((*colours.shape[:2], 1), np.float32)], axis=-1)


def near_zero(uv: np.ndarray, wrap: tuple[str, str]) -> np.ndarray:
    """Coordinates [F, 3, 2], those far from zero moved by pairs of repeats, which changes nothing of what is seen."""
    far = (np.abs(uv) > FAR_UV).any(axis=1)
    far &= np.array([how != "clamp" for how in wrap])
    if not far.any():
        return uv
    shift = np.where(far, 2.0 * np.floor(uv.min(axis=1) / 2.0), 0.0)
    return uv - shift[:, None]


def shares_outside(pieces: list[Piece]) -> Iterator[tuple[Texture, float]]:
    """Each texture, and the share of the triangles with it that reach outside of 0..1."""
    found: dict[Texture, list[np.ndarray]] = {}
    for piece in pieces:
        if piece.material is not None and piece.material.texture is not None and piece.uv is not None:
            outside = ((piece.uv < -1e-6) | (piece.uv > 1.0 + 1e-6)).any(axis=(1, 2))
            found.setdefault(piece.material.texture, []).append(outside)
    for texture, outside in found.items():
        yield texture, float(np.concatenate(outside).mean())


def check_finite(pieces: list[Piece], file: MeshFile, key: str | None) -> None:
    """Refuse texture coordinates that are not finite, or so far away that no texels can be told apart."""
    for piece in pieces:
        if piece.uv is not None and not np.isfinite(piece.uv).all():
            raise InputError(
                "has texture coordinates that are not finite",
                file=file.path,
                key=key,
                remedy="Unwrap it again, or give it a material of the scene.",
            )
        if piece.uv is not None and np.abs(piece.uv).max(initial=0.0) > FARTHEST_UV:
            raise InputError(
                f"has texture coordinates beyond {FARTHEST_UV:g}",
                file=file.path,
                key=key,
                value=float(np.abs(piece.uv).max()),
                remedy="Unwrap it again, or give it a material of the scene.",
            )
