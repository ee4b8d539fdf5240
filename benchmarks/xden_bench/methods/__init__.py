"""Running a method on a dataset folder, resumably, until it is a submission."""
