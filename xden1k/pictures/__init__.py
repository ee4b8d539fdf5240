"""An object to look at: radiographs beside their models, slices, parts."""
