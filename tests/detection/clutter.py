"""Pictures without any board that look like one here and there: textures, tiled floors, windows, keyboards, dots."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Grey = NDArray[np.uint8]
SIZE = (640, 480)


def cluttered(seed: int) -> Grey:
    """Picture number `seed`: one of the kinds in turn, at random places, tilts, sizes, light, blur and noise."""
    rng = np.random.default_rng(seed)
    kinds = (_texture, _tiles, _windows, _keyboard, _spots, _text)
    plane = kinds[seed % len(kinds)](rng)
    image = _photographed(plane, rng)
    image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.5, 1.5))
    ramp = 1.0 - rng.uniform(0.0, 0.5) * np.linspace(0, 1, SIZE[0])[None, :]
    return np.clip(image * ramp + rng.normal(0, 3, image.shape), 0, 255).astype(np.uint8)


def _photographed(plane: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """The plane seen at a tilt; it fills the picture."""
    h, w = plane.shape
    corners = np.array([[0, 0], [w, 0], [w, h], [0, h]], np.float32)
    jitter = rng.uniform(-0.2, 0.05, (4, 2)) * np.array(SIZE) * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
    quad = (np.array([[0, 0], [SIZE[0], 0], SIZE, [0, SIZE[1]]]) + jitter).astype(np.float32)
    H = cv2.getPerspectiveTransform(corners, quad)
    return np.asarray(cv2.warpPerspective(plane, H, SIZE, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REFLECT))


def _texture(rng: np.random.Generator) -> NDArray[np.float64]:
    """Noise of every size, as on plaster, wood or gravel."""
    image = np.zeros((480, 640))
    for k in range(1, 7):
        cells = rng.normal(0, 1, (480 >> k, 640 >> (k if rng.random() < 0.7 else max(k - 2, 0))))
        image += 2 ** (0.5 * k) * cv2.resize(cells, (640, 480), interpolation=cv2.INTER_CUBIC)
    return 120 + 60 * image / image.std()


def _tiles(rng: np.random.Generator) -> NDArray[np.float64]:
    """A floor of tiles: checked, but endless, or with joints, or with tiles of random greys."""
    columns, rows, side = int(rng.integers(14, 26)), int(rng.integers(12, 20)), 40
    greys = rng.uniform(40, 220, (rows, columns))
    if rng.random() < 0.5:
        greys = np.where(np.add.outer(np.arange(rows), np.arange(columns)) % 2, 210.0, 60.0)
    image = np.kron(greys, np.ones((side, side)))
    joint = int(rng.integers(0, 5))
    for i in range(0, max(image.shape), side):
        image[i : i + joint] = image[:, i : i + joint] = 30
    return image


def _windows(rng: np.random.Generator) -> NDArray[np.float64]:
    """A front with rows of windows, each of its own brightness, with frames."""
    image = np.full((600, 800), rng.uniform(120, 200))
    pitch_x, pitch_y = int(rng.integers(50, 110)), int(rng.integers(60, 120))
    for x in range(15, 800 - pitch_x, pitch_x):
        for y in range(15, 600 - pitch_y, pitch_y):
            image[y : y + int(0.7 * pitch_y), x : x + int(0.6 * pitch_x)] = rng.uniform(20, 110)
            image[y + int(0.35 * pitch_y) : y + int(0.35 * pitch_y) + 3, x : x + int(0.6 * pitch_x)] = 220
    return image


def _keyboard(rng: np.random.Generator) -> NDArray[np.float64]:
    """Rows of keys, shifted from row to row, with letters; light or dark."""
    light = rng.random() < 0.5
    # Text is drawn on 8 bits alone by OpenCV 5.
    image = np.full((400, 700), 60 if light else 200, np.uint8)
    key = int(rng.integers(34, 50))
    for row in range(400 // key):
        x = int(rng.integers(0, key))
        while x + key < 700:
            wide = key if rng.random() < 0.85 else 2 * key
            top_left, bottom_right = (x + 3, row * key + 3), (x + wide - 3, row * key + key - 3)
            cv2.rectangle(image, top_left, bottom_right, 210.0 if light else 40.0, -1)
            letter = chr(int(rng.integers(65, 91)))
            cv2.putText(image, letter, (x + 9, row * key + key - 12), 0, 0.6, 50.0 if light else 220.0, 2)
            x += wide
    return image.astype(np.float64)


def _spots(rng: np.random.Generator) -> NDArray[np.float64]:
    """Round spots: scattered ones of all sizes, or holes of a perforated sheet, endless."""
    image = np.full((480, 640), 210.0)
    if rng.random() < 0.5:
        for x, y, r in rng.uniform((0, 0, 3), (640, 480, 20), (120, 3)):
            cv2.circle(image, (int(x), int(y)), int(r), float(rng.uniform(20, 120)), -1, cv2.LINE_AA)
        return image
    pitch = int(rng.integers(16, 30))
    for j, y in enumerate(range(0, 480, pitch)):
        for x in range((j % 2) * pitch // 2, 640, pitch):
            cv2.circle(image, (x, y), pitch // 4, 40.0, -1, cv2.LINE_AA)
    return image


def _text(rng: np.random.Generator) -> NDArray[np.float64]:
    """A printed page with black boxes."""
    image = np.full((700, 800), 230, np.uint8)
    for y in range(30, 700, 26):
        words = "".join(chr(c) for c in rng.choice([*range(97, 123), 32, 32, 79, 48], 60))
        cv2.putText(image, words, (20, y), int(rng.integers(0, 4)), 0.6, 30.0, 1 + int(rng.random() < 0.3), cv2.LINE_AA)
    for x, y, w, h in rng.integers((0, 0, 20, 20), (700, 600, 120, 120), (6, 4)):
        cv2.rectangle(image, (int(x), int(y)), (int(x + w), int(y + h)), 20.0, -1)
    return image.astype(np.float64)
