"""Coding light fields on a GPU; the functions here run beside the device (`lfportrait.gpu`)."""
