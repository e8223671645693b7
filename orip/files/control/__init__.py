"""Control and preliminary coordinates as text: .PNT, .ELE, .LEN, .DIR, .STA, .REL, .PRE, read and edited by lines."""
