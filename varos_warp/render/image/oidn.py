"""Open Image Denoise, a filter for `denoise.Denoiser`: on a GPU the image is not copied to the host and back."""

import sys
import threading
import weakref
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec

import warp as wp

MOST_MB = 300
"""Memory that Open Image Denoise may take on a CPU [MB], about: it works in tiles then, with the same bytes. Without a
bound an image of 1280 x 720 takes 550, and four fifths of the time."""
_one_at_a_time = threading.Lock()
"""Lock by which one image is denoised at a time: on a CPU that uses all cores, and the bytes do not depend on their
number."""


def open_image_denoise():
    """The module ``pyoidn``, imported without torch.

    Where torch is installed, ``pyoidn`` imports it, which takes seconds, but needs it only for tensors.

    Raises:
        ImportError, OSError: If it cannot be loaded.
    """
    if not {"pyoidn", "torch"} & {*sys.modules}:
        sys.modules["torch"] = None
        try:
            import pyoidn
        finally:
            del sys.modules["torch"]
        for name, module in [*sys.modules.items()]:  # others may give it tensors
            if name.startswith("pyoidn.") and hasattr(module, "TORCH_AVAILABLE"):
                module.TORCH_AVAILABLE = find_spec("torch") is not None
    import pyoidn

    return pyoidn


class OpenImageDenoise:
    """Makes filters on one device, whose work is queued on the stream that Warp uses there when this is made.

    On a GPU they are kept from frame to frame, for setting one up takes longer than running it; on a CPU they are not,
    for one that is kept keeps its memory, too.

    Raises:
        ImportError, OSError: If Open Image Denoise cannot be loaded.
        RuntimeError: If it does not run on the device.
    """

    def __init__(self, device: str):
        self.device = wp.get_device(device)
        self._oidn = _open_device(self.device)
        self._kept: dict[tuple, _Filter] = {}
        # before the arrays that the filters point to, and before the interpreter takes the library down
        self._release = weakref.finalize(self, _release, self._kept, self._oidn)

    @contextmanager
    def filter(self, shape: tuple[int, int], quality: str, guides: Iterable[str]) -> Iterator["_Filter"]:
        """A filter for images [H, W] of a ``quality``, balanced or high, with the names of its guides."""
        key = (shape, quality, *guides)
        if not self.device.is_cpu:
            if key not in self._kept:
                self._kept[key] = _Filter(self._oidn, self.device, *key)
            yield self._kept[key]
            return
        with _one_at_a_time:
            made = _Filter(self._oidn, self.device, *key)
            try:
                yield made
            finally:
                made.release()


class _Filter:
    """Denoises ``color`` into ``output``, guided by the others of its images."""

    def __init__(self, oidn, device, shape: tuple[int, int], quality: str, *guides: str):
        pyoidn = open_image_denoise()
        height, width = shape
        self._oidn, self._waits = oidn, device.is_cpu
        self.images = {name: wp.zeros(shape, dtype=wp.vec3, device=device) for name in ("color", "output", *guides)}
        self._filter, self._buffers = pyoidn.Filter(oidn, pyoidn.OIDN_FILTER_TYPE_RT), []
        for name, image in self.images.items():
            buffer = pyoidn.Buffer.shared(oidn, image.ptr, height * width * wp.types.type_size_in_bytes(wp.vec3))
            self._filter.set_image(name, buffer, pyoidn.OIDN_FORMAT_FLOAT3, width, height)
            self._buffers.append(buffer)
        self._filter.set_bool("hdr", True)
        self._filter.set_bool("cleanAux", bool(guides))
        self._filter.set_quality({"balanced": pyoidn.OIDN_QUALITY_BALANCED, "high": pyoidn.OIDN_QUALITY_HIGH}[quality])
        if device.is_cpu:
            self._filter.set_int("maxMemoryMB", MOST_MB)
        self._filter.commit()
        _check(oidn, "setting up a filter")

    def run(self) -> None:
        """Denoise."""
        if self._waits:
            self._filter.execute()
        else:
            self._filter.execute_async()  # in the order of the stream
        _check(self._oidn, "denoising")

    def release(self) -> None:
        """Give back what the library holds."""
        for held in (self._filter, *self._buffers):
            held.release()


def _open_device(device):
    """Open Image Denoise's device: the same GPU and stream as Warp's."""
    pyoidn = open_image_denoise()
    oidn = pyoidn.Device(pyoidn.OIDN_DEVICE_TYPE_CPU) if device.is_cpu else _open_cuda(device)
    _check(oidn, f"opening {device.alias}")
    oidn.commit()
    _check(oidn, f"opening {device.alias}")
    return oidn


def _open_cuda(device):
    """A device on Warp's stream. The package opens one only for streams of torch, so its class is filled in here."""
    pyoidn = open_image_denoise()
    from pyoidn.capi import oidn_Capi, oidn_ffi

    if not pyoidn.Device.is_cuda_available(device.ordinal):
        raise RuntimeError(f"Open Image Denoise does not run on {device.alias} ({device.name})")
    _, stream = wp.get_stream(device).__cuda_stream__()
    streams = oidn_ffi.new("cudaStream_t[]", [oidn_ffi.cast("cudaStream_t", stream)])
    oidn = pyoidn.Device.__new__(pyoidn.Device)
    oidn._device = oidn_Capi.oidnNewCUDADevice(oidn_ffi.new("int[]", [device.ordinal]), streams, 1)
    if oidn._device == oidn_ffi.NULL:
        raise RuntimeError(f"Open Image Denoise cannot open {device.alias} ({device.name})")
    return oidn


def _check(oidn, what: str):
    """Raise what the library reports."""
    error = oidn.get_error()
    if error is not None:
        raise RuntimeError(f"Open Image Denoise, {what}: {error}")


def _release(filters: dict[tuple, _Filter], oidn):
    """Filters and buffers before their device, once all work on it is done."""
    oidn.wait()
    for one in filters.values():
        one.release()
    filters.clear()
    oidn.release()
