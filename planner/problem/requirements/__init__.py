"""What a motion must keep: `requirement` (what each kind answers), `limits`, `places`,
`self_collision`, `ends`, `user_places` (limits and goals of user coordinates)."""
