"""GestureMaster (Zhou et al. 2022): a database of gesture clips, searched for rhythm, style and transitions."""
