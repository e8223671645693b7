"""Control and preliminary coordinates as text: .PNT, .ELE, .LEN, .DIR, .CON, .STA and .PRE, read, edited by lines."""
