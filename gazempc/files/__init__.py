"""Files that anybody may have made: looked at before they are read, read within bounds, written whole."""
