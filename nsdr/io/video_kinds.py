"""Why a file cannot be read as a video: what it is instead."""

from pathlib import Path

from nsdr.errors import VideoError

__all__ = ["check_is_video", "undecodable"]

HEAD_BYTES = 4096
"""Bytes at a file's start that tell its kind."""
CONVERT = "convert it to H.264, for example: ffmpeg -i IN -c:v libx264 -pix_fmt yuv420p OUT.mp4"
IMAGES = {b"\x89PNG": "PNG", b"\xff\xd8\xff": "JPEG", b"BM": "BMP", b"II*\0": "TIFF", b"MM\0*": "TIFF"}
SOUNDS = {b"ID3": "MP3", b"\xff\xfb": "MP3", b"\xff\xf3": "MP3", b"fLaC": "FLAC", b"\xff\xf1": "AAC", b"MThd": "MIDI"}
OTHERS = {b"%PDF": "a PDF document", b"PK\x03\x04": "a zip archive", b"\x1f\x8b": "a gzip file"}
CODECS = {
    "AV01": "AV1",
    "VP90": "VP9",
    "VP80": "VP8",
    "HEVC": "H.265",
    "HVC1": "H.265",
    "HEV1": "H.265",
    "VVC1": "H.266",
}
"""Four-character codes of codecs that not every decoder knows, and their names."""


def check_is_video(path: Path) -> None:
    """Refuse what is certainly no video, by the file's first bytes.

    Raises:
        VideoError: no such file, a folder or device, an empty file, or an image, sound, text or archive; says which.
    """
    if path.is_dir():
        raise VideoError(f"{path}: is a folder; expected a video (`nsdr parse-videos` takes folders)")
    if not path.is_file():
        raise VideoError(f"{path}: {'is a device or a pipe; expected a video' if path.exists() else 'no such file'}")
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    if not head:
        raise VideoError(f"{path}: is empty (0 bytes); expected a video")
    if (found := _other_kind(head)) is not None:
        hint = "; nsdr.load(nsdr.Scene, ...) reads a saved scene" if path.suffix == ".json" else ""
        raise VideoError(f"{path}: is {found}; expected a video{hint}")


def _other_kind(head: bytes) -> str | None:
    """What a file with these first bytes is, if it is no video."""
    for signatures, kind in ((IMAGES, "image"), (SOUNDS, "sound")):
        for signature, name in signatures.items():
            if head.startswith(signature):
                return f"a {name} {kind}"
    if head[:4] == b"RIFF" and head[8:12] in (b"WAVE", b"WEBP"):
        return "a WAV sound" if head[8:12] == b"WAVE" else "a WebP image"
    if head[4:8] == b"ftyp" and head[8:11] in (b"M4A", b"M4B"):
        return "an M4A sound"
    for signature, name in OTHERS.items():
        if head.startswith(signature):
            return name
    return "a text file" if _is_text(head) else None


def _is_text(head: bytes) -> bool:
    try:
        text = head.decode("utf-8") if len(head) < HEAD_BYTES else head[:-4].decode("utf-8", "ignore")
    except UnicodeDecodeError:
        return False
    return all(c.isprintable() or c in "\n\r\t\f" for c in text)


def undecodable(path: Path, code: int = 0) -> VideoError:
    """The error about a file that OpenCV opened but cannot decode, or could not open.

    Args:
        path: the file.
        code: four-character code of its codec, as OpenCV reports it; 0 if unknown.
    """
    name = code.to_bytes(4, "little").decode("ascii", "replace").upper().strip("\0 ") if code > 0 else ""
    codec, sound = CODECS.get(name, ""), ""
    try:
        codec, sound = _streams(path)
    except ImportError:  # PyAV is an extra; without it the code must do
        pass
    except (OSError, ValueError):
        return VideoError(f"{path}: is not a video, or is damaged or cut off; {CONVERT}")
    if sound and not codec:
        return VideoError(f"{path}: holds sound ({sound}) but no video")
    if codec:
        return VideoError(f"{path}: {codec} video, which OpenCV cannot decode here; {CONVERT}")
    return VideoError(f"{path}: not a video that OpenCV can read; {CONVERT}")


def _streams(path: Path) -> tuple[str, str]:
    """Names of the codecs of a file's first video and sound, "" where it has none."""
    import av

    with av.open(str(path)) as container:
        names = [
            stream[0].codec_context.name if stream else ""
            for stream in (container.streams.video, container.streams.audio)
        ]
    return {"libdav1d": "AV1", "av1": "AV1", "libaom-av1": "AV1"}.get(names[0], names[0]), names[1]
