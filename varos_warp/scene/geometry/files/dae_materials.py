"""Materials of COLLADA as far as they are modelled: the diffuse colour or texture of an effect."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote, urlparse

import numpy as np

from varos_warp.scene.geometry.files.pieces import FileMaterial, MeshFile, Texture, in_words

SHADERS = ("phong", "blinn", "lambert", "constant")
UNMOVED = {
    "coverageU": 1,
    "coverageV": 1,
    "translateFrameU": 0,
    "translateFrameV": 0,
    "rotateFrame": 0,
    "repeatU": 1,
    "repeatV": 1,
    "offsetU": 0,
    "offsetV": 0,
    "rotateUV": 0,
    "mirrorU": 0,
    "mirrorV": 0,
    "stagger": 0,
    "wrapU": 1,
    "wrapV": 1,
}
"""What Maya and programs after it write beside a texture, and the values that leave it where it is."""
WRAPPING = {"WRAP": "repeat", "CLAMP": "clamp", "BORDER": "clamp", "MIRROR": "mirror", "MIRROR_ONCE": "mirror"}


@dataclass
class Look:
    """A material, and the set of coordinates that its texture takes."""

    material: FileMaterial
    coordinates: str | None = None


class DaeMaterials:
    """The materials of a COLLADA document."""

    def __init__(self, ids: dict[str | None, ET.Element], file: MeshFile):
        self.ids, self.file = ids, file

    def look(self, bound: ET.Element | None) -> Look | None:
        """The material that an ``instance_material`` binds; None if it says no diffuse colour."""
        material = None if bound is None else self._target(bound.get("target"))
        effect = None if material is None else self._target(_of(material, "instance_effect"))
        if effect is None:
            return None
        profile = effect.find("profile_COMMON")
        shader = (
            None
            if profile is None
            else next((found for name in SHADERS if (found := profile.find(f"technique/{name}")) is not None), None)
        )
        if shader is None:
            return None
        self._note(shader)
        diffuse = shader.find("diffuse" if shader.tag != "constant" else "emission")
        if diffuse is None:
            return None
        texture = diffuse.find("texture")
        if texture is not None:
            return self._textured(texture, profile, bound)
        colour = self._colour(diffuse, profile)
        return None if colour is None else Look(FileMaterial(colour))

    def _target(self, url):
        return self.ids.get((url or "").removeprefix("#"))

    def _note(self, shader):
        """What of a shader is not modelled."""
        if shader.find("transparent/texture") is not None or _opacity(shader) < 1.0:
            self.file.note("it has transparent materials, which are opaque here")
        glow = shader.find("emission")
        if (
            shader.tag != "constant"
            and glow is not None
            and (glow.find("texture") is not None or any(_numbers(glow.find("color"))[:3]))
        ):
            self.file.note("not modelled: emission")

    def _note_extra(self, texture):
        """Placings of a texture that only some programs know (``extra``)."""
        given = {element.tag: (element.text or "").strip().lower() for element in texture.iter()}
        flags = {"true": 1.0, "false": 0.0}
        moved = []
        for name in given.keys() & UNMOVED.keys():
            try:
                value = flags[given[name]] if given[name] in flags else float(given[name])
            except ValueError:
                continue
            if value != UNMOVED[name]:
                moved.append(name)
        if moved:
            self.file.note(f"what its <extra> says of where textures lie is not read: {in_words(sorted(moved))}")

    def _colour(self, diffuse, profile):
        element = diffuse.find("color")
        if element is None and (param := diffuse.find("param")) is not None:
            found = (self._parameter(profile, param.get("ref"), kind) for kind in ("float4", "float3"))
            element = next((given for given in found if given is not None), None)
        values = [float(word) for word in (element.text or "").split()][:3] if element is not None else []
        if len(values) != 3 or not np.isfinite(values).all():
            return None
        if not all(0.0 <= value <= 1.0 for value in values):
            self.file.note("a diffuse colour is not within 0..1, and is cut to that")
        return tuple(min(max(value, 0.0), 1.0) for value in values)

    def _textured(self, texture, profile, bound):
        """The texture that an effect names through sampler and surface, or by its image."""
        sid, wrap = texture.get("texture"), ("repeat", "repeat")
        self._note_extra(texture)
        image = self._target(sid)
        sampler = self._parameter(profile, sid, "sampler2D")
        if sampler is not None:
            wrap = tuple(
                WRAPPING.get((sampler.findtext(name) or "WRAP").strip(), "repeat") for name in ("wrap_s", "wrap_t")
            )
            surface = self._parameter(profile, (sampler.findtext("source") or "").strip(), "surface")
            named = surface.findtext("init_from") if surface is not None else (_of(sampler, "instance_image"))
            image = self._target((named or "").strip())
        path = None if image is None else self._path(image)
        if path is None:
            self.file.note(f"the texture {sid} names no picture: it is grey")
            return None
        coordinates = next(
            (
                entry.get("input_set")
                for entry in bound.findall("bind_vertex_input")
                if entry.get("semantic") == texture.get("texcoord")
            ),
            None,
        )
        return Look(FileMaterial(texture=Texture(path, f"image {image.get('id')}", wrap)), coordinates)

    def _parameter(self, profile, sid, kind):
        """What a ``newparam`` of a profile holds; None if there is no such."""
        for param in [*profile.iter("newparam")]:
            if param.get("sid") == sid:
                return param.find(kind)
        return None

    def _path(self, image) -> Path | None:
        """Path of an image's file: of a file URI, absolute, or relative to the document."""
        text = (image.findtext("init_from/ref") or image.findtext("init_from") or "").strip()
        if not text:
            return None
        if text.startswith("file:"):
            return self.file.path.parent / unquote(urlparse(text).path)
        return self.file.path.parent / unquote(text).replace("\\", "/")


def _of(element: ET.Element, tag: str) -> str | None:
    """The reference of a child; None without one."""
    child = element.find(tag)
    return None if child is None else child.get("url")


def _numbers(element: ET.Element | None) -> list[float]:
    """The numbers in an element's text; none without an element."""
    return [] if element is None else [float(word) for word in (element.text or "").split()]


def _opacity(shader: ET.Element) -> float:
    """Least opacity of a shader, as its ``transparent`` and its mode say (COLLADA 1.5, "Determining transparency").

    Without ``transparent``, a ``transparency`` of 0 is taken as none: programs before COLLADA 1.4.1 write it for that.
    """
    transparent, weight = shader.find("transparent"), (_numbers(shader.find("transparency/float")) or [1.0])[0]
    if transparent is None:
        return weight or 1.0
    *rgb, alpha = (_numbers(transparent.find("color")) + [1.0] * 4)[:4]
    return {"A_ZERO": 1.0 - alpha * weight, "RGB_ZERO": 1.0 - max(rgb) * weight, "RGB_ONE": min(rgb) * weight}.get(
        transparent.get("opaque", "A_ONE"), alpha * weight
    )
