"""Which way round each view's board was numbered."""
