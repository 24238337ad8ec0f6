"""Open Image Denoise on arrays of Warp where they lie: on a GPU the image is not copied to the host and back."""

import weakref

import warp as wp

from varos_warp.device.launcher import Launcher
from varos_warp.kernels.film.denoise import (
    add_mixed,
    add_scaled,
    clip_negative,
    mix_guide,
    positive_part,
    scale_to_unit,
    subtract,
)
from varos_warp.render.image.denoise import FAR, NEAR, PART_QUALITY, QUALITY, open_image_denoise


class DeviceDenoiser:
    """Denoises as `denoise.denoise_image` does with ``oidn``, on one device.

    Everything is queued on the stream that Warp uses on the device when this is made; nothing waits for the host.

    Args:
        launcher: Of the device.

    Raises:
        ImportError, OSError: If Open Image Denoise cannot be loaded.
        RuntimeError: If it does not run on the device.
    """

    def __init__(self, launcher: Launcher):
        self.launcher, self.device = launcher, wp.get_device(launcher.device)
        self._oidn = _open_device(self.device)
        self._networks: dict[tuple, _Network] = {}
        # before the arrays that the filters point to, and before the interpreter takes the library down
        self._release = weakref.finalize(self, _release, self._networks, self._oidn)

    def denoise(self, radiance, correction=None, base_variance=None, **guides) -> wp.array:
        """Linear radiance with less noise, not negative; all arrays are of vec3 [H, W] on this device.

        Args:
            radiance: The image.
            correction: What is denoised apart from the rest, the base; may be negative.
            base_variance: Of all but the correction, given with it: what is mixed by.
            guides: Of the correction, or the whole: ``albedo`` in [0, 1] and ``normal``, or neither.

        Raises:
            RuntimeError: If Open Image Denoise reports a failure.
        """
        with wp.ScopedDevice(self.device):
            result = wp.zeros_like(radiance)
            if correction is None:
                self._add_denoised(result, radiance, 1.0, QUALITY, guides)
            else:
                base, clean = wp.empty_like(radiance), wp.zeros_like(radiance)
                self.launcher.run(subtract, radiance.shape, {"image": radiance, "part": correction, "rest": base})
                self._add_denoised(clean, base, 1.0, PART_QUALITY, {})
                self.launcher.run(add_mixed, radiance.shape, {
                    "smooth": clean, "noisy": base, "variance": base_variance, "near": NEAR, "far": FAR,
                    "image": result})
                guides = self._correction_guides(result, **guides) if guides else guides
                for sign in (1.0, -1.0):
                    self._add_denoised(result, correction, sign, PART_QUALITY, guides)
            self.launcher.run(clip_negative, result.shape, {"image": result})
        return result

    def _correction_guides(self, base, albedo, normal) -> dict:
        """`denoise.correction_guides`."""
        albedo, light, total = wp.clone(albedo), wp.empty_like(base), wp.empty(1, dtype=wp.vec3)
        self.launcher.run(positive_part, base.shape, {"image": base, "sign": 1.0, "part": light})
        wp.utils.array_sum(light, out=total)
        self.launcher.run(mix_guide, base.shape, {"base": base, "total": total, "albedo": albedo})
        return {"albedo": albedo, "normal": normal}

    def _add_denoised(self, result, noisy, sign: float, quality: str, guides: dict):
        """Add ``sign`` times what is positive of ``sign`` times ``noisy``, denoised, to ``result``."""
        key = (noisy.shape, quality, *guides)
        if key not in self._networks:
            self._networks[key] = _Network(self._oidn, self.device, noisy.shape, quality, guides)
        network = self._networks[key]
        color, total = network.images["color"], wp.empty(1, dtype=wp.vec3)
        for name, guide in guides.items():
            wp.copy(network.images[name], guide)
        self.launcher.run(positive_part, noisy.shape, {"image": noisy, "sign": sign, "part": color})
        wp.utils.array_sum(color, out=total)
        self.launcher.run(scale_to_unit, noisy.shape, {"total": total, "image": color})
        network.run()
        self.launcher.run(add_scaled, noisy.shape, {
            "part": network.images["output"], "total": total, "sign": sign, "image": result})


class _Network:
    """A filter with images of its own, kept from frame to frame: setting one up takes longer than running it."""

    def __init__(self, oidn, device, shape: tuple[int, int], quality: str, guides):
        pyoidn = open_image_denoise()
        height, width = shape
        self._oidn = oidn
        self._wait = device.is_cpu
        self.images = {name: wp.zeros(shape, dtype=wp.vec3, device=device) for name in ("color", "output", *guides)}
        self.filter = pyoidn.Filter(oidn, pyoidn.OIDN_FILTER_TYPE_RT)
        self.buffers = []
        for name, image in self.images.items():
            buffer = pyoidn.Buffer.shared(oidn, image.ptr, height * width * wp.types.type_size_in_bytes(wp.vec3))
            self.filter.set_image(name, buffer, pyoidn.OIDN_FORMAT_FLOAT3, width, height)
            self.buffers.append(buffer)
        self.filter.set_bool("hdr", True)
        self.filter.set_bool("cleanAux", bool(guides))
        self.filter.set_quality({"balanced": pyoidn.OIDN_QUALITY_BALANCED, "high": pyoidn.OIDN_QUALITY_HIGH}[quality])
        self.filter.commit()
        _check(oidn, "setting up a filter")

    def run(self):
        """Denoise ``color`` into ``output``."""
        if self._wait:
            self.filter.execute()
        else:
            self.filter.execute_async()  # in the order of the stream
        _check(self._oidn, "denoising")


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


def _release(networks: dict, oidn):
    """Filters and buffers before their device, once all work on it is done."""
    oidn.wait()
    for network in networks.values():
        network.filter.release()
        for buffer in network.buffers:
            buffer.release()
    networks.clear()
    oidn.release()
