"""Posed colour pictures of an object: cameras, a renderer for phantoms, scene folders."""
