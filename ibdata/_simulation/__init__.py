"""Episodes side by side: `Carry` says where they are, `unroll` plays, `replay` asks about recorded ones."""
