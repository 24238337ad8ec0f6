"""Other renderers: export scenes to them, and compare image means with theirs."""

from pathlib import Path
from typing import Annotated

import typer

from benchmarks import peers
from varos_warp.errors import InputError, require_known
from varos_warp.scene.file.load import load_scene
from varos_warp.scene.geometry.build import build_parts
from varos_warp.sim.trajectory import simulate

app = typer.Typer(help=__doc__, no_args_is_help=True, add_completion=False)


@app.command()
def export(
    peer: Annotated[str, typer.Argument(help="mitsuba or cycles")],
    scene_file: Annotated[Path, typer.Argument(metavar="SCENE", help="scene file")],
    output: Annotated[Path, typer.Option("-o", "--output", help="FILE.xml or FILE.blend")],
    frame: Annotated[int, typer.Option(help="number of the frame", min=0)] = 0,
    camera: Annotated[int, typer.Option(help="number of the camera in the scene file", min=0)] = 0,
    spp: Annotated[int, typer.Option(help="samples per pixel", min=1)] = 64,
):
    """Write one frame of a scene as a file that the other program opens."""
    scene = load_scene(scene_file)
    run = simulate(scene)
    if frame >= len(run.frames) or camera >= len(scene.vehicle.cameras):
        raise InputError(
            "there is no such frame or camera",
            file=scene_file,
            key="--frame, --camera",
            value=(frame, camera),
            remedy=f"There are {len(run.frames)} frames and {len(scene.vehicle.cameras)} cameras, from 0.",
        )
    T_w_v = run.frames.T_w_v(frame)
    peers.export(peer, scene, build_parts(scene), scene.vehicle.cameras[camera], T_w_v, output, spp=spp)


@app.command()
def agree(
    seconds: Annotated[float, typer.Option(help="CPU-seconds for each peer, scene and water", min=1.0)] = 60.0,
    only: Annotated[list[str] | None, typer.Option(help="SCENE:WATER, such as lamps:hg0.8; may be repeated")] = None,
    peer: Annotated[list[str] | None, typer.Option(help="mitsuba or cycles; absent: all that are installed")] = None,
    light: Annotated[list[str] | None, typer.Option(help="'one event' or 'all'; absent: both")] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="JSON; absent: ../results")] = None,
):
    """Compare image means by this project and by the peers: soft lights, a lens and real meshes, in several waters."""
    from benchmarks.peers.agree import AGREEMENT, CASES, TOLERANCE, measure

    known = {":".join(case): case for case in CASES}
    for key, names, there_are in (("--only", only, known), ("--light", light, TOLERANCE)):
        for name in names or ():
            require_known(name, there_are, "there is no such case", key=key)
    for name in peer or ():
        peers.check_available(name)
    measure(seconds, output or AGREEMENT, [known[name] for name in only or known], peer, light or tuple(TOLERANCE))


def main():
    try:
        app()
    except InputError as error:
        typer.echo(error.message, err=True)
        raise SystemExit(2) from None


if __name__ == "__main__":
    main()
