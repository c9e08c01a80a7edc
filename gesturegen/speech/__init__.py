"""Audio onsets, transcripts and keywords."""
