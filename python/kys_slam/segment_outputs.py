# SPDX-License-Identifier: BSD-3-Clause
"""From the outputs of segmentation networks to segments of an image: one decoder per layout
(docs/guide.md, "Model files"), then painting. Without the rest of the package, as segment_network."""

from typing import NamedTuple

import numpy as np

MIN_PIXELS = 150     # of an instance found by connected components
MOST_OBJECTS = 300   # of one image
SAME_OBJECT = 0.7    # intersection over union of two boxes of one class, above which they are one object
WHOLE = 0.8          # share of a query's mask that others must leave, or it is dropped


class Found(NamedTuple):
    """Objects of one image, in the network's geometry."""

    masks: np.ndarray   # (N, h, w) float32, above 0 inside
    labels: np.ndarray  # (N,) int, index into the network's classes
    scores: np.ndarray  # (N,) 0 to 1


class LayoutError(ValueError):
    """Outputs that are not of the layout; the message says how."""


def masks_of(masks, labels, scores, threshold):
    """Masks (.., N, h, w) from 0 to 1 with their labels and scores."""
    masks, labels, scores = np.asarray(masks), np.ravel(labels).astype(int), np.ravel(scores)
    masks = np.squeeze(masks) if masks.ndim > 3 else masks
    masks = masks.reshape(-1, *masks.shape[-2:])
    if not len(masks) == len(labels) == len(scores):
        raise LayoutError(f"{len(masks)} masks, {len(labels)} labels, {len(scores)} scores")
    good = scores >= threshold
    return Found(masks[good].astype(np.float32) - 0.5, labels[good], scores[good])


def sigmoid(values):
    return 1 / (1 + np.exp(-np.clip(values, -50, 50)))


def distinct(boxes, labels, scores):
    """Indices of objects, best first, without those whose box is one of a better object of the class.
    Boxes: (N, 4) left, top, right, bottom."""
    areas = np.prod(np.maximum(boxes[:, 2:] - boxes[:, :2], 0), axis=1)
    waiting = np.argsort(-scores, kind="stable")
    kept = []
    while len(waiting) and len(kept) < MOST_OBJECTS:
        best, waiting = waiting[0], waiting[1:]
        kept.append(best)
        overlap = np.prod(np.maximum(np.minimum(boxes[best, 2:], boxes[waiting, 2:]) -
                                     np.maximum(boxes[best, :2], boxes[waiting, :2]), 0), axis=1)
        same = overlap > SAME_OBJECT * (areas[best] + areas[waiting] - overlap)
        waiting = waiting[~(same & (labels[waiting] == labels[best]))]
    return np.array(kept, int)


def prototypes_of(detections, prototypes, classes, size, threshold):
    """YOLO with masks. Prototypes (1, K, h, w); detections either (1, 4 + classes + K, N): centre, width,
    height (px of the network's image), class scores, K weights, of which boxes of one object are
    dropped; or (1, N, 6 + K): corners, score, class, weights, final (nms=True, YOLO26).

    size: (height, width) of the network's image.
    """
    prototypes = np.asarray(prototypes, np.float32)
    if prototypes.ndim == 4:
        prototypes = prototypes[0]
    rows = np.asarray(detections, np.float32)
    rows = rows[0] if rows.ndim == 3 else rows
    if prototypes.ndim != 3 or rows.ndim != 2:
        raise LayoutError(f"detections {np.shape(detections)} and prototypes {prototypes.shape}")
    count = len(prototypes)
    if rows.shape[0] == 4 + classes + count:
        rows = rows.T
        half = rows[:, 2:4] / 2
        boxes = np.concatenate([rows[:, :2] - half, rows[:, :2] + half], axis=1)
        labels, scores = np.argmax(rows[:, 4:4 + classes], axis=1), np.max(rows[:, 4:4 + classes], axis=1)
    elif rows.shape[1] == 6 + count:
        boxes, scores, labels = rows[:, :4], rows[:, 4], rows[:, 5].astype(int)
    else:
        raise LayoutError(f"detections {np.shape(detections)}: neither 4 + {classes} classes + {count} "
                          f"weights by objects, nor objects by 6 + {count}")
    good = np.flatnonzero((scores >= threshold) & np.isfinite(rows).all(axis=1))
    good = good[distinct(boxes[good], labels[good], scores[good])]
    masks = np.tensordot(rows[good, -count:], prototypes, axes=1)
    scale = np.array([prototypes.shape[2] / size[1], prototypes.shape[1] / size[0]] * 2)
    for mask, box in zip(masks, boxes[good] * scale):  # a mask says nothing outside its box
        left, top, right, bottom = np.clip(np.round(box), 0, 1 << 20).astype(int)
        inside = np.zeros(mask.shape, bool)
        inside[top:bottom, left:right] = True
        mask[~inside] = np.minimum(mask[~inside], -1)
    return Found(masks, labels[good], scores[good])


def queries_of(logits, masks, activation, threshold):
    """Query networks: class logits (1, Q, classes), with "softmax" one more for no object (Mask2Former,
    EoMT), with "sigmoid" none (RF-DETR); mask logits (1, Q, h, w)."""
    logits, masks = np.asarray(logits, np.float32), np.asarray(masks, np.float32)
    if logits.ndim == 3:
        logits = logits[0]
    if masks.ndim == 4:
        masks = masks[0]
    if logits.ndim != 2 or masks.ndim != 3 or len(logits) != len(masks):
        raise LayoutError(f"class logits {logits.shape} and masks {masks.shape}: not those of the same "
                          "queries")
    if activation == "softmax":
        powers = np.exp(logits - np.max(logits, axis=1, keepdims=True))
        scores = powers / np.sum(powers, axis=1, keepdims=True)
    else:
        scores = sigmoid(logits)
    labels, best = np.argmax(scores, axis=1), np.max(scores, axis=1)
    objects = logits.shape[1] - (activation == "softmax")
    good = (best >= threshold) & (labels < objects)
    return Found(masks[good], labels[good], best[good])


def components(mask):
    """Connected components (label image, 0 none) of at least MIN_PIXELS."""
    import cv2

    count, parts, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=4)
    large = stats[:, cv2.CC_STAT_AREA] >= MIN_PIXELS
    large[0] = False
    return np.where(large, np.arange(count), 0)[parts]


class Canvas:
    """Segments of one image, painted one over the other."""

    def __init__(self, size):
        self.ids = np.zeros(size, np.uint32)  # 0 void
        self._segments = []

    def add(self, mask, entry):
        """entry: (name, id of the data set, thing) of its class."""
        if not mask.any():
            return
        number = len(self._segments) + 1
        self.ids[mask] = number
        self._segments.append({"id": number, "category_id": entry[1], "isthing": int(entry[2])})

    def segments(self):
        """segments_info of COCO; what is covered by others is gone."""
        present, areas = np.unique(self.ids, return_counts=True)
        area_of = dict(zip(present.tolist(), areas.tolist()))
        return [dict(s, area=area_of[s["id"]]) for s in self._segments if s["id"] in area_of]


def paint_objects(canvas, found, classes, enlarged):
    """The surest last, so that it is on top. enlarged: (h, w) mask -> that of the image."""
    for k in np.argsort(found.scores, kind="stable"):
        label = found.labels[k]
        if 0 <= label < len(classes) and classes[label] is not None:
            canvas.add(enlarged(found.masks[k]) > 0, classes[label])


def paint_queries(canvas, found, classes, enlarged):
    """Every pixel to the query of the largest score times mask; stuff of one class is one segment."""
    best = np.zeros(canvas.ids.shape, np.float32)
    winner = np.full(canvas.ids.shape, -1)
    areas = np.zeros(len(found.scores), int)
    for k, (mask, score) in enumerate(zip(found.masks, found.scores)):
        mask = enlarged(mask)
        inside = mask > 0
        areas[k] = np.count_nonzero(inside)
        value = score * sigmoid(mask)
        ahead = inside & (value > best)
        best[ahead], winner[ahead] = value[ahead], k
    stuff = {}
    for k, label in enumerate(found.labels.tolist()):
        own = winner == k
        if label >= len(classes) or classes[label] is None or \
                np.count_nonzero(own) <= WHOLE * areas[k]:
            continue
        if classes[label][2]:
            canvas.add(own, classes[label])
        else:
            stuff[label] = own | stuff.get(label, False)
    for label, mask in stuff.items():
        canvas.add(mask, classes[label])


def paint_classes(canvas, labels, classes):
    """(H, W) indices of classes; connected parts of things are instances."""
    for label, entry in enumerate(classes):
        mask = labels == label
        if entry is None or not mask.any():
            continue
        if not entry[2]:
            canvas.add(mask, entry)
            continue
        parts = components(mask)
        for part in np.unique(parts[parts > 0]):
            canvas.add(parts == part, entry)
