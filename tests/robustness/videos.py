"""Hostile videos: animated images that become large, files that make a reader open others, and headers that say too little."""

import struct
from collections.abc import Iterator

from tests.robustness.case import Case, text_writer

PLAYLIST = "#EXTM3U\n#EXT-X-VERSION:3\n#EXT-X-TARGETDURATION:6\n#EXTINF:5.12,\n/etc/passwd\n#EXT-X-ENDLIST\n"
SCRIPT = "ffconcat version 1.0\nfile /etc/passwd\n"
XML = (
    '<?xml version="1.0"?><MPD xmlns="urn:mpeg:dash:schema:mpd:2011" type="static"><BaseURL>/etc/passwd</BaseURL></MPD>'
)
SDP = "v=0\nc=IN IP4 127.0.0.1\nm=video 5004 RTP/AVP 96\n"
NAMING = {"playlist": PLAYLIST, "script": SCRIPT, "manifest": XML, "session": SDP}
"""Texts by which FFmpeg opens something else."""


def gif(frames: int, side: int, comment_bytes: int = 0) -> bytes:
    """A GIF whose frames are one pixel each, of which a reader has to make square images of `side` pixels."""
    colors = b"\0\0\0\xff\xff\xff"
    blocks = comment_bytes // 255 * (b"\xff" + bytes(255))
    frame = b"!\xf9\x04\x04\x04\0\0\0,\0\0\0\0\x01\0\x01\0\0\x02\x02\x44\x01\0"
    comment = b"!\xfe" + blocks + b"\0" if comment_bytes else b""
    return b"GIF89a" + struct.pack("<HH", side, side) + b"\x80\0\0" + colors + comment + frames * frame + b";"


def _webp(frames: int, side: int) -> bytes:
    """The headers of an animated WebP, whose frames hold nothing."""
    size = (side - 1).to_bytes(3, "little")
    chunks = b"VP8X" + struct.pack("<I", 10) + b"\x02\0\0\0" + size + size + b"ANIM" + struct.pack("<I", 6) + bytes(6)
    one = bytes(6) + size + size + (40).to_bytes(3, "little") + b"\0" + b"VP8L" + struct.pack("<I", 0)
    chunks += frames * (b"ANMF" + struct.pack("<I", len(one)) + one)
    return b"RIFF" + struct.pack("<I", 4 + len(chunks)) + b"WEBP" + chunks


IMAGES = {
    "6,000 large frames": lambda: gif(6000, 3160),
    "11,000 small frames": lambda: gif(11_000, 8),
    "frames of 65,535 pixels a side": lambda: gif(3, 65_535),
    "a comment of 5 MB": lambda: gif(3, 100, 5_000_000),
    "WebP of 6,000 large frames": lambda: _webp(6000, 3160),
    "WebP of 11,000 small frames": lambda: _webp(11_000, 8),
    "WebP of empty frames": lambda: _webp(10, 320),
}
"""Animated images that are refused before they are decoded."""


def hostile_video_cases() -> Iterator[Case]:
    """All hostile videos."""
    for name, make in IMAGES.items():
        for command, argv in {
            "answer": ("answer", "video.gif", "How many collisions happen?"),
            "judge": ("judge", "video.gif"),
        }.items():
            write = lambda folder, good, make=make: (folder / "video.gif").write_bytes(make())  # noqa: E731
            yield Case(f"animated image, {command}", name, argv, write, "video.gif")
    for name, text in NAMING.items():
        for how, content in {
            "as it is": text,
            "a control byte after the first line": text.replace("\n", "\n#\x01\n", 1),
            "zero bytes at the end": text + "\0" * 5000,
            "after the start of a raw video": "\0\0\0\x01" + text,
            "with a byte order mark": "\ufeff" + text,
        }.items():
            for file in ("video.mp4", "video.m3u8", "video.ffconcat"):
                argv = ("answer", file, "How many collisions happen?")
                yield Case("video that names files", f"{name}, {how}, {file}", argv, text_writer(file, content), file)
