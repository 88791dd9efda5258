"""Sheets as files at true size: SVG and PDF as vectors, PNG as pixels with its resolution written in it."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calibrant.arrays import Array
from calibrant.errors import InputError
from calibrant.opencv import cv2
from calibrant.reports.sheet import TEXT_MM, DiscFill, Fill, Label, Sheet

POINTS_PER_MM = 72.0 / 25.4
# The finest of these that keeps the picture within a size that viewers open.
RESOLUTIONS_DPI = (600, 300, 200, 150, 100)
MOST_PIXELS = 60e6
BAND_PX = 512
"""Rows painted at once: a sheet of 60 million pixels takes 15 times its size in memory otherwise."""
FIXED_POINT_BITS = 8
# Four cubic arcs this long make a circle to 3 parts in 10000: 4/3 (sqrt 2 - 1).
ARC = 4.0 / 3.0 * (np.sqrt(2.0) - 1.0)


def svg(sheet: Sheet) -> bytes:
    """The sheet as SVG, one user unit a millimetre."""
    w, h = sheet.size
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{w:g}mm" height="{h:g}mm" viewBox="0 0 {w:g} {h:g}">',
        f'<rect width="{w:g}" height="{h:g}" fill="#ffffff"/>',
    ]
    for item in sheet.items:
        if isinstance(item, Fill):
            path = "".join("M" + "L".join(f"{x:.5f} {y:.5f}" for x, y in ring) + "Z" for ring in item.rings)
            lines.append(f'<path d="{path}" fill="{_hex(item.grey)}"/>')
        elif isinstance(item, DiscFill):
            (x, y), r = item.centre, item.radius
            lines.append(f'<circle cx="{x:.5f}" cy="{y:.5f}" r="{r:.5f}" fill="{_hex(item.grey)}"/>')
        else:
            (x, y), text = item.at, escape(item.text)
            lines.append(
                f'<text x="{x:.3f}" y="{y:.3f}" font-family="Helvetica,Arial" font-size="{TEXT_MM}">{text}</text>'
            )
    return ("\n".join([*lines, "</svg>"]) + "\n").encode()


def pdf(sheet: Sheet) -> bytes:
    """The sheet as PDF 1.4, one page of the sheet's size (ISO 32000-1: objects, page tree, content stream)."""
    w, h = (POINTS_PER_MM * n for n in sheet.size)
    # One transform for all: millimetres from the top left.
    content = [f"{POINTS_PER_MM:.9f} 0 0 {-POINTS_PER_MM:.9f} 0 {h:.6f} cm"]
    for item in sheet.items:
        content.append(_pdf_item(item))
    stream = zlib.compress("\n".join(content).encode("latin-1", "replace"))
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {w:.6f} {h:.6f}] /Contents 4 0 R "
        "/Resources << /Font << /F1 5 0 R >> >> >>".encode(),
        f"<< /Length {len(stream)} /Filter /FlateDecode >>\nstream\n".encode() + stream + b"\nendstream",
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
    ]
    out, offsets = bytearray(b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n"), []
    for number, body in enumerate(objects, start=1):
        offsets.append(len(out))
        out += f"{number} 0 obj\n".encode() + body + b"\nendobj\n"
    start = len(out)
    out += f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n".encode()
    out += "".join(f"{offset:010d} 00000 n \n" for offset in offsets).encode()
    out += f"trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\nstartxref\n{start}\n%%EOF\n".encode()
    return bytes(out)


def png(sheet: Sheet) -> bytes:
    """The sheet as a grey PNG whose pHYs chunk tells the resolution."""
    dpi = resolution_dpi(sheet)
    ok, encoded = cv2.imencode(".png", pixels(sheet, dpi))
    if not ok:
        raise InputError(
            f"the sheet of {sheet.size[0]:g} x {sheet.size[1]:g} mm could not be encoded as PNG; use PDF or SVG"
        )
    data = bytes(encoded)
    per_metre = round(dpi / 0.0254)
    body = b"pHYs" + struct.pack(">IIB", per_metre, per_metre, 1)
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    after_header = 8 + 25  # signature, then the IHDR chunk: 4 length + 4 name + 13 data + 4 checksum
    return data[:after_header] + chunk + data[after_header:]


def resolution_dpi(sheet: Sheet) -> int:
    """Dots per inch that a PNG of the sheet gets."""
    area = sheet.size[0] * sheet.size[1] / 25.4**2
    return next((d for d in RESOLUTIONS_DPI if area * d**2 <= MOST_PIXELS), RESOLUTIONS_DPI[-1])


def pixels(sheet: Sheet, dpi: float) -> NDArray[np.uint8]:
    """The sheet in pixels (h, w); a pixel is as grey as the part of it that is inked: edges lie where they should, not
    on the nearest dot, which every photo of the board would show displaced alike."""
    scale = dpi / 25.4
    image = np.full((round(sheet.size[1] * scale), round(sheet.size[0] * scale)), 255, np.uint8)
    for item in sheet.items:
        if isinstance(item, Label):
            x, y = (round(scale * n) for n in item.at)
            size = scale * TEXT_MM / 30.0  # a letter of this font is about 21 units high at size 1, 30 with its line
            thickness = max(1, round(0.25 * scale))
            cv2.putText(image, item.text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, size, 0, thickness, cv2.LINE_AA)
        elif isinstance(item, DiscFill):
            _fill_disc(image, item, scale)
        else:
            _fill(image, [np.array(ring) * scale for ring in item.rings], round(255 * item.grey))
    return image


def _fill(image: NDArray[np.uint8], rings: Sequence[Array], grey: int) -> None:
    """Paints rings, px, that do not overlap; where two of them share a pixel, what they cover of it adds up."""
    boxes = np.array([[ring.min(axis=0), ring.max(axis=0)] for ring in rings if _is_box(ring)])
    for ring in (ring for ring in rings if not _is_box(ring)):
        corners = np.round((ring - 0.5) * 2**FIXED_POINT_BITS).astype(np.int32)
        cv2.fillPoly(image, [corners], grey, lineType=cv2.LINE_8, shift=FIXED_POINT_BITS)
    if len(boxes) == 0:
        return
    size = np.array(image.shape[::-1])
    low = np.clip(np.floor(boxes.min(axis=(0, 1))), 0, size).astype(int)
    high = np.clip(np.ceil(boxes.max(axis=(0, 1))), low, size).astype(int)
    x = np.arange(low[0], high[0])
    for start in range(low[1], high[1], BAND_PX):
        y = np.arange(start, min(start + BAND_PX, high[1]))
        within = (boxes[:, 0, 1] < y[-1] + 1) & (boxes[:, 1, 1] > start)
        rows, columns = (_covered(at, boxes[within][..., axis]) for at, axis in ((y, 1), (x, 0)))
        _blend(image[y[0] : y[-1] + 1, low[0] : high[0]], rows.T @ columns, grey)


def _is_box(ring: Array) -> bool:
    low, high = ring.min(axis=0), ring.max(axis=0)
    return len(ring) == 4 and bool(np.all(np.isclose(ring, low) | np.isclose(ring, high)))


def _covered(at: NDArray[np.int64], spans: Array) -> NDArray[np.float32]:
    """Part of each pixel at .. at + 1 that each span (n, 2) covers, (n, pixels)."""
    edges = np.clip(np.append(at, at[-1] + 1), spans[:, :1], spans[:, 1:])
    return np.diff(edges, axis=1).astype(np.float32)


def _blend(image: NDArray[np.uint8], cover: NDArray[np.float32], grey: int) -> None:
    """Lays a grey over a part of the picture as far as it covers each pixel."""
    image[:] = np.rint(image + np.clip(cover, 0, 1) * (np.float32(grey) - image)).astype(np.uint8)


def _fill_disc(image: NDArray[np.uint8], disc: DiscFill, scale: float) -> None:
    (cx, cy), r = (scale * n - 0.5 for n in disc.centre), scale * disc.radius
    x0, x1 = max(int(cx - r), 0), min(int(cx + r) + 2, image.shape[1])
    y0, y1 = max(int(cy - r), 0), min(int(cy + r) + 2, image.shape[0])
    x, y = np.arange(x0, x1), np.arange(y0, y1)[:, None]
    # A rim is straight over a pixel: it covers as much as its distance from the pixel's middle says.
    cover = np.clip(r - np.hypot(x - cx, y - cy) + 0.5, 0, 1).astype(np.float32)
    _blend(image[y0:y1, x0:x1], cover, round(255 * disc.grey))


def _hex(grey: float) -> str:
    return "#" + 3 * f"{round(255 * grey):02x}"


def _pdf_item(item: Fill | DiscFill | Label) -> str:
    if isinstance(item, Fill):
        if not item.rings:
            return ""
        rings = (
            " l ".join(f"{x:.5f} {y:.5f}" for x, y in ring).replace(" l ", " m ", 1) + " l h" for ring in item.rings
        )
        return f"{item.grey:g} g " + " ".join(rings) + " f"
    if isinstance(item, DiscFill):
        (x, y), r, a = item.centre, item.radius, ARC * item.radius
        arcs = [(r, a, a, r, 0, r), (-a, r, -r, a, -r, 0), (-r, -a, -a, -r, 0, -r), (a, -r, r, -a, r, 0)]
        curves = " ".join(
            " ".join(f"{(x, y)[i % 2] + offset:.5f}" for i, offset in enumerate(arc)) + " c" for arc in arcs
        )
        return f"{item.grey:g} g {x + r:.5f} {y:.5f} m {curves} h f"
    text = item.text.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
    return f"BT 0 g /F1 {TEXT_MM} Tf 1 0 0 -1 {item.at[0]:.4f} {item.at[1]:.4f} Tm ({text}) Tj ET"


WRITERS: dict[str, Callable[[Sheet], bytes]] = {".pdf": pdf, ".svg": svg, ".png": png}


def writer_for(path: Path) -> Callable[[Sheet], bytes]:
    """The writer of a file's ending. Raises: InputError listing the known ones."""
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise InputError(f"cannot write artwork to {path}: its ending must be one of {', '.join(WRITERS)}")
    return writer
