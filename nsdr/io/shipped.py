"""Where the files lie that ship beside the package: checkpoints and configurations."""

from pathlib import Path

from nsdr.errors import DataError


def shipped_folders(name: str) -> list[Path]:
    """The places of a folder that ships, such as "checkpoints".

    These are the checkout, and `share/nsdr` of the environment, where an installed wheel puts the folder.
    """
    above = Path(__file__).resolve().parents
    # Not sys.prefix: pip also installs for a user, into a folder, and on Debian below /usr/local.
    installed = [folder / "share" / "nsdr" / name for folder in above]
    return [above[2] / name, *[folder for folder in installed if folder.is_dir()][:1]]


def find_config(file_or_name: str | Path, group: str) -> Path:
    """The YAML file of a configuration.

    Args:
        file_or_name: a file; or the name of a configuration that ships, without an ending, such as "paper" or "small/mac".
        group: the subfolder of `configs` in which the name is looked for, such as "pipeline".

    Raises:
        DataError: no configuration of this name ships (lists those that do), or a file is not there whose path is that of one
            that ships (names it).
    """
    given = Path(file_or_name)
    # Of two files of one name, that of the checkout counts.
    folders = [root / group for root in reversed(shipped_folders("configs"))]
    files = {f.relative_to(folder).with_suffix("").as_posix(): f for folder in folders for f in folder.rglob("*.yaml")}
    if given.as_posix() in files:
        return files[given.as_posix()]
    if given.suffix or given.name != str(file_or_name):
        name = given.with_suffix("").as_posix().rpartition(f"configs/{group}/")[2]
        if given.suffix == ".yaml" and name in files and not given.exists():
            raise DataError(
                f"{given}: no such file; the configuration of this path that ships is named {name}: --config {name}"
            )
        return given
    known = ", ".join(sorted(files)) or "none"
    raise DataError(f"no configuration {given.name!r} ships; expected a YAML file, or one of {known}")
