"""Control and preliminary coordinates as text: .PNT, .ELE, .LEN, .DIR, .STA and .PRE, read and edited by lines."""
