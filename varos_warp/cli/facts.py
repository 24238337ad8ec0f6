"""What `varos-warp info` prints: the facts of a scene as tables."""

from math import pi

from varos_warp.cli.tables import number, print_survey, print_table
from varos_warp.errors import counted, duration


def print_info(facts: dict) -> None:
    """The facts of `scene_info` as tables, with those of `course_facts` in ``trajectory``."""
    _print_course(facts)
    _print_recorded(facts["trajectory"])
    _print_dataset(facts["dataset"])
    _print_water(facts["water"])
    _print_cameras(facts)
    _print_lights(facts["lights"])
    _print_imu(facts.get("imu"))
    _print_sensors(facts.get("sensors", {}))
    _print_meshes(facts)


def _print_course(facts: dict) -> None:
    """Name, course and vehicle, in one line."""
    trajectory, vehicle = facts["trajectory"], facts["vehicle"]
    pattern = f" ({trajectory['pattern']})" if "pattern" in trajectory else ""
    last, target = trajectory["count"] - 1, trajectory["heads_for"]
    part = "" if target is None else f" (on the way to {trajectory['kind'].removesuffix('s')} {target} of 0 to {last})"
    body = f" with {vehicle['thrusters']} thrusters" if vehicle.get("thrusters") else ""
    print(
        f"{facts['name']}: {trajectory['count']} {trajectory['kind']}{pattern}, {trajectory['length_m']:.1f} m in "
        f"{trajectory['duration_s']:.1f} s{part}, vehicle of {vehicle['mass_kg']:g} kg{body}"
    )


def _print_water(water: dict) -> None:
    """Coefficients by channel or wavelength, and the phase function."""
    if "wavelength_nm" in water:
        _print_spectra(water)
        return
    rows = {
        "absorption a [1/m]": "a",
        "scattering b [1/m]": "b",
        "extinction c [1/m]": "c",
        "albedo b / c": "albedo",
        "mean free path [m]": "mean_free_path_m",
        "10 % of the light left at [m]": "range_10_percent_m",
    }
    print_table(
        [f"water (g = {water['g']:.4g})", "red", "green", "blue"],
        [[name, *(number(x) for x in water[key])] for name, key in rows.items()],
    )
    _print_phase(water["phase"])
    print_table(
        ["bodies in the water", "share of b", "at most", "radii [mm]", "per litre", "wider than 0.5 mm"],
        [
            [
                str(i),
                f"{100 * kind['share']:.3g} %",
                f"{100 * kind['largest_share']:.4g} %",
                " to ".join(f"{1e3 * r:g}" for r in kind["radius_m"]),
                f"{kind['per_litre']:.3g}",
                f"{kind['per_litre_over_0.5_mm']:.3g}",
            ]
            for i, kind in enumerate(water.get("particles", []))
        ],
    )
    if water.get("particles"):
        print(
            "wider than 0.5 mm the sea has about 1 to 10 a litre at coasts, 0.1 to 1 far from them (after "
            "Alldredge and Silver 1988)"
        )


def _print_spectra(water: dict) -> None:
    """Coefficients by wavelength, and the bands that stand for them."""
    columns = ("a", "b", "c", "b_b", "visibility_m")
    print_table(
        [f"{water['source']} [nm]", "a [1/m]", "b [1/m]", "c [1/m]", "b_b [1/m]", "visibility 4.8 / c [m]"],
        [[f"{nm:g}", *(number(water[name][i]) for name in columns)] for i, nm in enumerate(water["wavelength_nm"])],
    )
    low, high = water["paths_m"]
    print_table(
        ["bands of", "wavelengths [nm]", f"rms error R, G, B, paths of {low:g} to {high:g} m", "worst", "backscatter"],
        [
            [
                bands["camera"],
                ", ".join(f"{nm:g}" for nm in bands["wavelength_nm"]),
                *(", ".join(f"{100 * e:.2g} %" for e in bands[name]) for name in ("rms", "worst", "backscatter")),
            ]
            for bands in water["bands"]
        ],
    )
    _print_phase(water["phase"])


def _print_cameras(facts: dict) -> None:
    """Intrinsics, mounts and exposures."""
    print_table(
        ["camera", "resolution", "fx, fy [px]", "cx, cy (COLMAP)", "cx, cy (OpenCV)", "field of view [deg]"],
        [
            [
                c["id"],
                " x ".join(map(str, c["resolution"])),
                f"{c['fx']:.3f}, {c['fy']:.3f}",
                f"{c['cx_colmap']:g}, {c['cy_colmap']:g}",
                f"{c['cx_opencv']:g}, {c['cy_opencv']:g}",
                f"{c['horizontal_fov_deg']:.1f} x {c['vertical_fov_deg']:.1f}",
            ]
            for c in facts["cameras"]
        ],
    )
    _print_mounts(facts)
    print_table(
        ["exposure of", "time [ms]", "readout [ms]", "longest streak [px]", "skew [px]"],
        [
            [
                s["id"],
                f"{1e3 * s['time_s']:g}",
                f"{1e3 * s['readout_s']:g}",
                f"{s['streak_px']:.3g}",
                f"{s['skew_px']:.3g}",
            ]
            for s in facts["exposures"]
        ],
    )


def _brightness(light: dict) -> str:
    """Intensity by channel, or a spectrum and how much of it."""
    if "spectrum" not in light:
        return str(light["intensity"])
    amount = f"{light['power_W']:g} W" if "power_W" in light else f"{light['lumen']:g} lm"
    return f"{light['spectrum']}, {amount}"


def _print_lights(lights: list[dict]) -> None:
    """Positions, cones and intensities of lights, and what files say of them."""
    print_table(
        ["light", "kind", "position [m]", "cone or fan [deg]", "intensity [W/sr]"],
        [
            [
                str(i),
                light["kind"],
                str(light["position"]),
                number(light.get("cone_deg", light.get("fan_deg"))),
                _brightness(light),
            ]
            for i, light in enumerate(lights)
        ],
    )
    print_profiles(lights)


def _print_meshes(facts: dict) -> None:
    """Meshes and the files they are of, the survey, and the body of the vehicle."""
    print_table(
        ["mesh", "vertices", "triangles", "size [m]", "from [m]", "to [m]"],
        [
            [
                m["name"],
                str(m["vertices"]),
                str(m["triangles"]),
                " x ".join(f"{high - low:.3g}" for low, high in zip(*m["bounds_m"], strict=True)),
                *map(_place, m["bounds_m"]),
            ]
            for m in facts["meshes"]
        ],
    )
    if relief := facts.get("relief"):
        factor = next(iter(relief.values()))["edge_factor"]
        longer = f", times {factor:g} to keep within render.max_triangles" if factor > 1.0 else ""
        print(
            f"relief: {sum(each['triangles'] for each in relief.values())} triangles; edges are about two pixels of "
            f"the nearest view{longer}"
        )
    print_table(
        ["growth", "kind", "copies", "of them fine, coarser, coarsest", "triangles", "on", "too small, left out"],
        [
            [
                g["name"],
                g["kind"],
                str(g["copies"]),
                ", ".join(map(str, g["by_level"])),
                str(g["triangles"]),
                ", ".join(f"{name}: {count}" for name, count in g["on"].items()),
                f"about {g['too_small']}",
            ]
            for g in facts.get("growth", [])
        ],
    )
    _print_files(facts["mesh_files"])
    if survey := facts.get("survey"):
        print_survey(survey)
    if body := facts.get("body"):
        low, high = body["bounds_m"]
        seen = ", ".join(body["seen_by"]) or "none, for there is no other"
        print(
            f"body: {body['triangles']} triangles from {_place(low)} to {_place(high)} in vehicle axes; vehicles "
            f"that see it: {seen}"
        )


def _print_imu(imu: dict | None) -> None:
    """How much the readings of the IMU err."""
    if imu is None:
        return
    noise, units = imu["noise"], {"accelerometer": ("m/s^2", "m/s^3"), "gyroscope": ("rad/s", "rad/s^2")}
    told = (
        "no noise"
        if noise is None
        else "; ".join(
            f"{sensor} {noise[f'{sensor}_noise_density']:.3g} {unit}/sqrt(Hz), random walk "
            f"{noise[f'{sensor}_random_walk']:.3g} {change}/sqrt(Hz)"
            for sensor, (unit, change) in units.items()
        )
    )
    print(f"IMU: {imu['rate_hz']:g} Hz, {told}")


def _print_sensors(sensors: dict) -> None:
    """Rates, places and keys of the sensors that the scene asks for."""
    print_table(
        ["sensor", "rate [Hz]", "position [m]", "keys"],
        [
            [
                name,
                f"{block['rate_hz']:g}",
                _place(block["position"]),
                ", ".join(f"{key}: {value}" for key, value in block.items() if key not in ("rate_hz", "position")),
            ]
            for name, block in sensors.items()
        ],
    )


def _print_files(files: list[dict]) -> None:
    """What became of the mesh files, and what to say where that is a guess."""
    head = ["mesh file", "of", "up", "unit [m]", "triangles", "without area", "area [m2]", "textures (beside 0..1)"]
    print_table(
        head,
        [
            [
                f["file"],
                f["name"],
                f["up"] + " (a guess)" * f["up_is_guess"],
                number(f["unit_m"]),
                str(f["triangles"]),
                str(f["without_area"]),
                f"{f['area_m2']:.4g}",
                ", ".join(map(_texture, f["textures"])) or "none",
            ]
            for f in files
        ],
    )
    if guessed := [f["name"] for f in files if f["up_is_guess"]]:
        print(
            f"Which way is up, the files of {', '.join(guessed)} do not say: z is taken. If they stand wrong, say "
            "`up: y` there."
        )


def _texture(facts: dict) -> str:
    """A texture in words."""
    outside = f" ({facts['outside']:.0%})" if facts["outside"] > 0.0 else ""
    return facts["name"] + outside + ", one colour throughout" * facts["constant"]


def _print_recorded(trajectory: dict) -> None:
    """What a file of poses was read as, and what its course makes the IMU feel."""
    if (about := trajectory.get("recorded")) is None:
        return
    whose = {"vehicle": "the vehicle", "imu": "the IMU, in its axes"}.get(about["of"], f"camera {about['of']}")
    axes = f", body axes {about['body']}" if "body" in about else ""
    attitude = "" if about["attitude"] == "recorded" else f", attitude {about['attitude']}"
    print(
        f"recorded course: {about['file']} ({about['format']}), poses of {whose}, one in {about['step_s']:.4g} s, "
        f"frame {about['frame']}{axes}{attitude}"
    )
    if smoothing := about.get("smoothing"):
        changes = [
            f"{words} by {smoothing[key]['rms']:.2g} {unit} RMS, {smoothing[key]['peak']:.2g} at most"
            for key, words, unit in (("moved_m", "moves poses", "m"), ("turned_deg", "turns them", "degrees"))
            if key in smoothing
        ]
        print(f"smoothing: {'; '.join(changes)}")
    felt, turned = trajectory["acceleration"], trajectory["angular_velocity"]
    degrees = 180.0 / pi
    print(
        f"acceleration: {felt['rms']:.3g} m/s^2 RMS, {felt['peak']:.3g} at most; angular rate: "
        f"{degrees * turned['rms']:.3g} deg/s RMS, {degrees * turned['peak']:.3g} at most"
    )


def print_profiles(lights: list[dict]) -> None:
    """What the files of lamps say, and what is made of it."""
    for i, light in enumerate(lights):
        if not (profile := light.get("profile")):
            continue
        around = f"changes by up to {100 * profile['uneven']:.2g} % of the peak around the axis"
        if profile["round"]:
            around = f"{around}: round, by the mean" if profile["uneven"] else "the same all around the axis"
        print(
            f"light {i}: {light['file']}, {profile['source']}, up to {profile['ends_at_deg']:g} degrees from the "
            f"axis, {around}",
            *profile["notes"],
            sep="; ",
        )


def _print_mounts(facts: dict) -> None:
    """Positions and directions of cameras, baselines of stereo pairs, and what was not asked for."""
    print_table(
        ["camera", "on", "position [m]", "looks along"],
        [[c["id"], f"the {c['mount']}", _place(c["position"]), _place(c["looks_along"])] for c in facts["cameras"]],
    )
    for pair in facts["stereo"]:
        print(f"stereo pair {', '.join(pair['cameras'])}: baseline {pair['baseline_m']:.4g} m")
    for c in facts["cameras"]:
        if c["defaults"]:
            print(f"camera {c['id']}: not given, so those of the paper's camera: {', '.join(c['defaults'])}")
        if c["calibration"]:
            print(
                f"camera {c['id']}: intrinsics, distortion and resolution are those of {c['calibration']}; where it "
                "is mounted is as the scene says, not as that file (T_cam_imu, T_cn_cnm1)"
            )
        if end := c["lens_end"]:
            print(
                f"camera {c['id']}: {counted(end['pixels'], 'pixel')} ({100 * end['share']:.2g} %) see nothing and "
                f"are black: the lens ends {end['half_angle_deg']:.1f} degrees from its axis, {end['radius_px']:.0f} "
                "px from the principal point"
            )


def _place(values: list[float]) -> str:
    """Return coordinates in brackets; far away to the centimetre, where four digits are none."""
    return f"({', '.join(f'{x:.4g}' if abs(x) < 1e4 else f'{x:.2f}' for x in values)})"


def _print_dataset(dataset: dict) -> None:
    """What `varos-warp run` will make, and take."""
    where = "a GPU" if dataset["device"] == "cuda" else counted(dataset["cores"], "free core")
    through = f" through {dataset['cameras']} cameras" * (dataset["cameras"] > 1)
    made = f"{counted(dataset['frames'], 'frame')}{through}, {counted(dataset['images'], 'image')}"
    print(
        f"dataset: {made}, about {_size(dataset['bytes'])}, "
        f"roughly {duration(dataset['seconds'])} on {where}{_samples(dataset)}; varos-warp plan measures it"
    )
    once = []
    if dataset["compile_seconds"] >= 0.1 * dataset["seconds"]:
        once.append(f"compiling: {duration(dataset['compile_seconds'])}, the first time only")
    if dataset["plan_seconds"] >= 5.0:
        less = "--spp N takes less" if dataset["spp_is_planned"] else "none with --integrator field or path"
        once.append(f"planning: {duration(dataset['plan_seconds'])}, once for this scene; {less}")
    for part in once:
        print(f"of that, {part}")


def _samples(dataset: dict) -> str:
    """How many samples images in the water have, where there are such."""
    if dataset["spp"] is None:
        return ""
    return f" with {counted(dataset['spp'], 'sample')} per pixel of A" + (
        " (a plan may take more: many more in turbid water near a floor)" * dataset["spp_is_planned"]
    )


def _size(count: float) -> str:
    size, name = (1e9, "GB") if count >= 1e9 else (1e6, "MB")
    return f"{float(f'{count / size:.2g}'):g} {name}"  # two digits, but 430 rather than 4.3e+02


def _print_phase(phase: dict) -> None:
    """What there is to know of a phase function that g does not say, and what was done to a table."""
    if phase["kind"] == "henyey_greenstein":
        return
    parts = phase.get("of", [phase])
    kinds = " + ".join(f"{part['weight']:g} {part['kind']}" for part in parts) if "of" in phase else phase["kind"]
    print(f"phase function: {kinds}, backscatter fraction {phase['backscatter_fraction']:.4g}")
    for part in parts:
        if "integral" in part:
            ahead, behind = (100 * part[f"share_{where}_row"] for where in ("ahead_of_first", "behind_last"))
            name = part["file"] or part["kind"]
            print(
                f"  {name}: integral over the sphere {part['integral']:.5g}, normalised to 1; "
                f"{ahead:.2g} % of the light ahead of its first row, {behind:.2g} % behind its last"
            )
