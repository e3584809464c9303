"""``insnav tune``: noise of an IMU from drives with it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from insnav.cli.console import note, result_page, working
from insnav.cli.data_options import Data, takes_data
from insnav.cli.options import Force, Json, Out, argument
from insnav.exceptions import ConfigError


@takes_data(
    None,
    files={"gps": False},
    only=("imu_model", "axes", "units", "lever_arm", "lever_arm_sd", "gps_delay", "gps_height"),
)
def tune(
    data: Data,
    drives: Annotated[list[Path], argument("DRIVE", "Folders of recordings, or one IMU file.")],
    out: Out = Path("tune"),
    force: Force = False,
    as_json: Json = False,
) -> None:
    """Find the noise of an IMU."""
    with working(out, force) as (folder, stage):
        stage("reading")
        from insnav.fleet.recordings import find_drives
        from insnav.imu import to_toml
        from insnav.messages import sentence
        from insnav.report.page import Page
        from insnav.report.run.quantities import noise_section
        from insnav.report.save import write_page
        from insnav.session.tuning import tune as tuned

        if data.gps is not None and len(drives) > 1:
            fix = "put the files of each drive into a folder of their own"
            raise ConfigError("the fixes of one file are of one drive", where="--gps", fix=fix)
        recordings: list[tuple[Path, Path | None]] = []
        for place in drives:
            one = place.is_file()
            recordings += [(place, data.gps)] if one else [each.files() for each in find_drives(place, out, 1)[0]]
        found, loaded, different = tuned(recordings, **data.inputs)
        note(f"prior: {loaded[0].imu_spec.name}: {sentence(loaded[0].imu_chosen)}")
        stage("writing")
        summary = f"The log-likelihood is {found.gain:.0f} above that of the prior; drives: {len(loaded)}."
        page = Page(f"Noise of an IMU: {found.spec.name}", (summary,), (noise_section(found),), tuple(different))
        metadata = {"kind": "tune", "configuration": data.options}
        where = write_page(folder, page, metadata, {"imu.toml": to_toml(found.spec)})
    result_page(where, page, out, as_json=as_json, more=("imu.toml",))
