"""How others find targets, as one would set them up for the scenes of the benches.

Everybody's settings are for bright dots of 8 to 20 px at up to 45 degrees: area,
roundness, contrast.
"""

from __future__ import annotations

import cv2
import numpy as np

#: A dot of 8 px at 45 degrees, one of 20 px facing, with a margin.
AREA_PX = (20.0, 420.0)
AXES_PX = (3.0, 24.0)
LEAST_ASPECT = 0.5
#: Twice the same place within this is one find.
SAME_PX = 2.0


def merged(places):
    """Places without those that stand within SAME_PX of one before them."""
    kept = []
    for x, y in places:
        if all((x - a) ** 2 + (y - b) ** 2 > SAME_PX**2 for a, b in kept):
            kept.append((x, y))
    return np.array(kept).reshape(-1, 2)


def ellipses(image, contours):
    """Centres of ellipses through contours that are of a dot's size, round and bright."""
    height, width = image.shape
    places = []
    for contour in contours:
        if not 8 <= len(contour) <= 200:
            continue
        (x, y), axes, _ = cv2.fitEllipse(contour)
        low, high = min(axes), max(axes)
        if not (AXES_PX[0] <= low and high <= AXES_PX[1] and low >= LEAST_ASPECT * high):
            continue
        if abs(cv2.contourArea(contour) - 0.785 * low * high) > 0.25 * 0.785 * low * high:
            continue
        reach = 0.5 * high + 2.5
        # A ring may stand on one side or two, not all around.
        around = [(x + reach, y), (x - reach, y), (x, y + reach), (x, y - reach)]
        if not (reach <= x < width - 1 - reach and reach <= y < height - 1 - reach):
            continue
        darkest = min(int(image[round(b), round(a)]) for a, b in around)
        if int(image[round(y), round(x)]) > darkest + 20:
            places.append((x, y))
    return merged(places)


def canny(image):
    edges = cv2.Canny(image, 50, 150)
    return ellipses(image, cv2.findContours(edges, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0])


def otsu(image):
    _, mask = cv2.threshold(image, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    return ellipses(image, cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0])


def adaptive(image):
    mask = cv2.adaptiveThreshold(image, 255, cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY, 41, -15)
    return ellipses(image, cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0])


def components(image):
    """Areas above Otsu's threshold, their grey values' centroid."""
    level, mask = cv2.threshold(image, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask)
    places = []
    for k, (x, y, w, h, area) in enumerate(stats):
        if not (AREA_PX[0] <= area <= AREA_PX[1] and 0.5 * w <= h <= 2 * w):
            continue
        if not 0.65 * w * h < area < 0.9 * w * h:
            continue
        part = labels[y : y + h, x : x + w] == k
        weight = np.where(part, image[y : y + h, x : x + w] - level, 0.0)
        total = weight.sum()
        places.append(
            (x + weight.sum(0) @ np.arange(w) / total, y + weight.sum(1) @ np.arange(h) / total)
        )
    return np.array(places).reshape(-1, 2)


def simple_blob():
    p = cv2.SimpleBlobDetector_Params()
    p.minThreshold, p.maxThreshold, p.thresholdStep = 40, 200, 20
    p.minRepeatability, p.minDistBetweenBlobs = 2, 6
    p.filterByColor, p.blobColor = True, 255
    p.filterByArea, (p.minArea, p.maxArea) = True, AREA_PX
    p.filterByCircularity, p.minCircularity = True, 0.7
    p.filterByConvexity, p.minConvexity = True, 0.9
    p.filterByInertia, p.minInertiaRatio = True, 0.3
    detector = cv2.SimpleBlobDetector_create(p)
    return lambda image: np.array([k.pt for k in detector.detect(image)]).reshape(-1, 2)


def openptv(size):
    """OpenPTV's target_recognition, or None where optv is not installed."""
    try:
        from optv.parameters import ControlParams, TargetParams
        from optv.segmentation import target_recognition
    except ImportError as error:
        print(f"left out: OpenPTV ({error}); pip install optv")
        return None
    control = ControlParams(1)
    control.set_image_size(size)
    targets = TargetParams(
        discont=60,
        gvthresh=[70],
        pixel_count_bounds=tuple(int(a) for a in AREA_PX),
        xsize_bounds=(4, 26),
        ysize_bounds=(4, 26),
        min_sum_grey=1000,
    )

    def work(image):
        found = target_recognition(image, targets, 0, control)
        # Its origin is the corner of the first pixel.
        return np.array([t.pos() for t in found]).reshape(-1, 2) - 0.5

    return work


def peers(size):
    """Names, and what takes an 8-bit picture of ``size`` to centres (N, 2)."""
    known = [
        ("OpenCV Canny + contours + fitEllipse", canny),
        ("OpenCV Otsu + contours + fitEllipse", otsu),
        ("OpenCV adaptive + contours + fitEllipse", adaptive),
        ("OpenCV components + grey centroid", components),
        ("OpenCV SimpleBlobDetector", simple_blob()),
        ("OpenPTV target_recognition", openptv(size)),
    ]
    return [(name, work) for name, work in known if work]
