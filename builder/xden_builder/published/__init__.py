"""The release as its authors published it: read, registered, and given densities of our own."""
