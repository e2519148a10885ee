"""A virtual microscope: height maps of a face whose motion is known, rendered without a grid."""
