"""The open benchmark: a folder of plain files in, problems and checked solutions out, and the way back."""
