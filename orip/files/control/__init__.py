"""Control and preliminary coordinates as text: .PNT, .ELE, .LEN, .DIR, .CON, .STA, .REL, .PRE; edited by lines."""
