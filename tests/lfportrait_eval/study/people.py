"""Small videos to compare, and people made up to answer."""

import json

import numpy as np

from lfportrait.files import write_image
from lfportrait.share import write_video

METHODS = ("arf", "paper", "skin")


def collection(folder, methods=METHODS, sitters=("anna", "ben"), styles=("ink", "oil")):
    """Folder SITTER/STYLE/METHOD.mp4 with paintings and photos; the videos' paths."""
    videos = []
    for one, sitter in enumerate(sitters):
        write_image(folder / sitter / "photo.png", np.full((40, 30, 3), 60 * one + 90, np.uint8))
        for two, style in enumerate(styles):
            place = folder / sitter / style
            write_image(place / "painting.png", np.full((40, 30, 3), 60 * two + 60, np.uint8))
            for three, method in enumerate(methods):
                frames = np.full((20, 48, 48, 3), 40, np.uint8)
                for time, frame in enumerate(frames):
                    frame[10:30, 2 * time:2 * time + 6, three % 3] = 200 - 30 * (three // 3)
                    frame[40:, :, one] = 90 + 100 * two
                write_video(place / f"{method}.mp4", frames, 10, preset="superfast")
                videos.append(place / f"{method}.mp4")
    return videos


def answer(design, number, prefers):
    """What the page writes for a person; ``prefers(question, left, right)`` gives a side."""
    sheet = number % len(design["sheets"])
    shown = [(pair, bool(side), False) for pair, side in design["sheets"][sheet]]
    shown += [(pair, not side, True) for pair, side, _ in shown[:design["repeats"]]]
    trials = []
    for pair, swapped, repeat in shown:
        left, right = (design["entries"][each] for each in design["pairs"][pair])
        if swapped:
            left, right = right, left
        names = [question["name"] for question in design["questions"]]
        trials.append({"pair": pair, "sitter": left["sitter"], "style": left["style"],
                       "left": left["method"], "right": right["method"], "repeat": repeat,
                       "choices": {name: prefers(name, left["method"], right["method"])
                                   for name in names},
                       "seconds": dict.fromkeys(names, 2.0)})
    return {"format": "lfportrait study answers", "study": design["study"], "title": "T",
            "person": str(number), "sheet": sheet, "questions": design["questions"],
            "trials": trials}


def by_strength(strengths, generator):
    """A person who chooses as Bradley and Terry think; ``strengths`` are logarithms."""
    def prefers(_, left, right):
        chance = 1 / (1 + np.exp(strengths[right] - strengths[left]))
        return "left" if generator.random() < chance else "right"

    return prefers


def write_answers(folder, design, count, prefers):
    """Answer files of some people."""
    folder.mkdir(exist_ok=True)
    files = []
    for number in range(count):
        file = folder / f"{number:03}.json"
        file.write_text(json.dumps(answer(design, number, prefers)))
        files.append(file)
    return files
