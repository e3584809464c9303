"""What a run says about itself: facts, figures, a page, one screen of text, and runs side by side."""
