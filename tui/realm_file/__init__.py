"""A whole realm as one file: written from what runs (`save`), and brought about again (`apply`)."""
