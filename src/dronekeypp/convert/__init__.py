"""Write a data set of whole frames as a detector wants it: in Ultralytics' layout, or with COCO files.

A detector finds the box that `predict` needs. Its data lie in a folder of their own:

    OUT/images/SPLIT/FLIGHT_NUMBER.jpg     the data set's own pictures: linked, or copied where that fails
    OUT/labels/SPLIT/FLIGHT_NUMBER.txt     yolo: one line for each drone, or none; see `baselines.yolo_layout`
    OUT/data.yaml                          yolo: what Ultralytics is told to train on
    OUT/SPLIT.json                         coco: of train, val and test; file names start at OUT
    OUT/convert.json                       what was converted, and how

The splits are the data set's, so every flight lies in one of them.
"""

from dronekeypp.convert.run import convert

__all__ = ["convert"]
