"""Is a video one of CLEVRER's scenes, and where in its frames is the image?"""
