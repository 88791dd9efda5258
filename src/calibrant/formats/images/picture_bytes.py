"""The bytes of a picture before they are decoded, of a file or a recording: whole, one picture, and not too large."""

from __future__ import annotations

from calibrant.errors import InputError
from calibrant.formats.images import header as image_header

MOST_PIXELS = 250_000_000
"""Of a frame or an image: the largest sensors have as many."""
_VAST, _UNFOLDED = 100_000_000, 100
"""Searching a hundred megapixels takes 0.7 GB. Above, a file must have a photo's bytes: the coarsest JPEG has one for
every 50 pixels, a bomb one for a thousand."""


def require_picture(data: bytes, what: str) -> None:
    """Raises: InputError, which begins with `what`, for bytes that are empty, cut off, of a picture that would fill the
    memory, or of several."""
    if not data:
        raise InputError(f"{what} is empty (0 bytes)")
    if image_header.is_cut_off(data):
        raise InputError(f"{what} is cut off: its {len(data)} bytes end before the picture does; copy it again")
    refuse_vast(image_header.size(data), len(data), what)
    count = image_header.pictures(data)
    if count > 1:
        raise InputError(
            f"{what} holds {count} pictures (an animation, or pages); expected one a file: save each on its own, "
            "or all as a video"
        )


def refuse_vast(size: tuple[int, int] | None, count: int, what: str) -> None:
    """Raises: InputError for a picture that would fill the memory: more pixels than sensors have, or than bytes tell.

    Args: size: width and height as the file states them, where it does; count: its bytes.
    """
    if size is None:
        return
    pixels = size[0] * size[1]
    if pixels > MOST_PIXELS:
        raise InputError(
            f"{what} states {size[0]}x{size[1]} px; expected {MOST_PIXELS / 1e6:g} megapixels at most, as the largest "
            "sensors have"
        )
    if pixels > _VAST and pixels > _UNFOLDED * count:
        raise InputError(
            f"{what} states {size[0]}x{size[1]} px and has {count:,} bytes, {pixels / count:,.0f} pixels a byte; "
            f"expected {_UNFOLDED} pixels a byte at most. It is blank, or made to fill the memory"
        )


def damage(data: bytes) -> str | None:
    """What is wrong with a JPEG or PNG file whose bytes were changed, of which decoders still make a picture; None
    where nothing is, and for other forms."""
    if data[:3] != image_header.JPEG:
        return image_header.png_damage(data)
    # The kernel is loaded for such files alone.
    from calibrant.formats.images.jpeg import jpeg_damage

    return jpeg_damage(data)
