"""Ground control and preliminary coordinates as text: .PNT, .ELE, .LEN, .DIR and .PRE, read and edited by lines."""
